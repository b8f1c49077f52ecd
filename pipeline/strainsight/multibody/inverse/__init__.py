"""The step of a system as a filter wants it: unknown loads and parameters from what sensors read."""
