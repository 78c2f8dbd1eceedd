"""A run or a study as a page, its verdict first: what it says, and how that is written."""
