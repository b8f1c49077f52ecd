"""What `import` writes: the mesh, and the faces that it finds on its surface."""

from __future__ import annotations

from strainsight.records.mesh import MeshColumns
from strainsight.records.record import group, record
from strainsight.sensors.faces import Faces


@record
class Imported:
    """import.h5 of a structure."""

    mesh: MeshColumns = group(path="")
    found: Faces | None = group(path="/faces/found", default=None)
