"""Page of a placement."""
