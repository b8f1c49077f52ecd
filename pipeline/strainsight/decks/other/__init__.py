"""Meshes of any format that meshio reads."""
