"""Single-point position and velocity."""
