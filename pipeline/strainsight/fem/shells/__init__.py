"""Flat shells of 3 and 4 nodes and curved ones of 6 and 8, with six motions a node: many elements of one kind at once."""

from __future__ import annotations

from strainsight.fem.shells.matrices import shell_masses, shell_stiffnesses
from strainsight.fem.shells.tria import shell_axes

__all__ = ["shell_axes", "shell_masses", "shell_stiffnesses"]
