"""Rigid grains: contact dynamics with exact Coulomb friction (differential variational inequality)."""
