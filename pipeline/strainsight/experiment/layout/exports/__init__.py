"""A layout as files for other programs."""
