"""Page of a suite."""
