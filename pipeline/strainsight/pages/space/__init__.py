"""Interactive 3D view of the structure: geometry, data and script."""
