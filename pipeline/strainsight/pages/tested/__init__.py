"""The page after a test: what its measurements say, how well they are matched, and the file that they came from."""
