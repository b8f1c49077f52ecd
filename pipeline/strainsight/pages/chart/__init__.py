"""Charts as SVG: their style, their panels, and themselves as files with the numbers that they draw."""
