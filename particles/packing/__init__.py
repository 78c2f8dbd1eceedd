"""Packings to start from."""
