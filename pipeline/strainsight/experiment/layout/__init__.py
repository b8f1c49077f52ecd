"""Placement from a pool of gauges and a linear problem, common to structures and benches."""
