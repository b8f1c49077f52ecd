"""Meshes: decks in, `Mesh` out, and what ParaView reads."""
