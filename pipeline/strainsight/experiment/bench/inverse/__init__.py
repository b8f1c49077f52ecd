"""Estimate of a bench: unknowns, truth, filter, comparison."""
