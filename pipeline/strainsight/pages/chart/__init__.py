"""Charts as SVG, and as files with their numbers."""
