"""Matrices, modes and results that another program computed."""
