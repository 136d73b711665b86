"""Satellite positions, clocks and the atmosphere between them and the antenna."""
