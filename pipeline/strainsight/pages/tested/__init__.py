"""Page of a test: estimates, residuals and measurement file."""
