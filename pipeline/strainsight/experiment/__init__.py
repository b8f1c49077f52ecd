"""Stages of a run as functions of config models and arrays."""
