"""Stiffness and mass from files."""
