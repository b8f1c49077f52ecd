"""The flexible bodies of a bench, from the artefacts of `import` and `reduce`."""

from __future__ import annotations

from strainsight.mesh.model import Mesh
from strainsight.records.bodies import ReducedBody, body_from
from strainsight.records.mesh import mesh_from
from strainsight.workflow.stage import Context


def flexible_bodies(context: Context) -> tuple[dict[str, ReducedBody], dict[str, Mesh]]:
    """Reduced bodies and their meshes by name; the stage has `import` and `reduce` upstream."""
    names = [name for name, body in context.config.bodies.items() if body.type == "flexible"]
    reduced = {name: body_from(context.upstream["reduce"], name) for name in names}
    return reduced, {name: mesh_from(context.upstream["import"], f"/bodies/{name}") for name in names}
