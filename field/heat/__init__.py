"""Conduction of heat in the section of a device of revolution, steady and in time."""
