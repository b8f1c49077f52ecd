"""What becomes of artefacts on pages: rows, numbers, words."""
