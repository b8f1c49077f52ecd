"""The page of a placement."""
