"""Every compiled loop of the package, and nothing else.

Modules here import NumPy and Numba only. They know arrays and integer codes, not files, settings or
objects; the public wrappers validate, convert to contiguous arrays and call them.
"""
