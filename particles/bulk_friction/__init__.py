"""Bulk friction of a dry powder: its measurement, and the pairs of contact parameters that give one."""
