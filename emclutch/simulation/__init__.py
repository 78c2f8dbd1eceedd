"""One run: decided, packed, assembled, marched and summed up."""
