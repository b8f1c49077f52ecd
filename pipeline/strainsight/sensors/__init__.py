"""Strain gauges: admissible positions, strain operators (matrix H), and selection."""
