"""A run or a study as a page, its verdict first."""
