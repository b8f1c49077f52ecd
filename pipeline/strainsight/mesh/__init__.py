"""Meshes: import of decks as `Mesh`, and export for ParaView."""
