"""Comparison of a solution with a reference: alignment in time, wrapped differences, statistics."""
