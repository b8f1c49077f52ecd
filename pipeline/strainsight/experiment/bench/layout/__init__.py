"""Placement on a bench: pool, linearised bench, layouts."""
