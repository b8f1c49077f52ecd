"""The pages of a bench, of a bearing, and of a suite of benches."""
