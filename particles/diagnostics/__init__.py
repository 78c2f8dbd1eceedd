"""Diagnostics of grains and contacts, as pure functions: nothing here changes a state."""
