"""Force laws between two frames."""
