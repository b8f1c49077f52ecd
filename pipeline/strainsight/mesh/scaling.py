"""A structure of another size."""

from __future__ import annotations

from dataclasses import replace

from strainsight.mesh.model import Mesh


def scaled(mesh: Mesh, s: float) -> Mesh:
    """The structure s times as large, of the same material: x → s x, point masses m → s³ m, their inertia → s⁵.

    Stiffness grows with s, mass with s³, frequencies fall with 1/s. Forces of the file stay as they are.
    """
    if s == 1.0:
        return mesh
    masses = tuple(
        replace(own, mass=s**3 * own.mass, offset=s * own.offset, inertia=s**5 * own.inertia)
        for own in mesh.point_masses
    )
    return replace(mesh, position=s * mesh.position, point_masses=masses)
