"""Readers of files: one module per format, one registry that tells them apart."""
