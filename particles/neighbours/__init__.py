"""Neighbours, contacts and their history."""
