"""The page of a suite of placements."""
