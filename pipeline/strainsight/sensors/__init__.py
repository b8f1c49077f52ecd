"""Strain gauges: where they can sit, what they read, which are worth keeping."""
