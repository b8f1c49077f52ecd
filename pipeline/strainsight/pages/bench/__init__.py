"""Pages of a bench and of a bearing."""
