"""Differencing, cycle slips, integer searches and their validation."""
