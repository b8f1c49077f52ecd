"""Experiments on a structure: estimation problem, simulated truth, validation, test."""
