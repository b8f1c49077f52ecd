"""Mesh files and decks in, a `Mesh` out."""
