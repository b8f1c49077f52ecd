"""A structure of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.model import Mesh


def scaled(mesh: Mesh, s: float) -> Mesh:
    """The structure s times as large, of the same material: x → s x, point masses m → s³ m, their inertia → s⁵.

    Stiffness grows with s, that of springs too, mass with s³, frequencies fall with 1/s. Forces of the file stay as they are.
    """
    if s == 1.0:
        return mesh
    masses = tuple(
        replace(own, mass=s**3 * own.mass, offset=s * own.offset, inertia=s**5 * own.inertia)
        for own in mesh.point_masses
    )
    springs = tuple(
        replace(
            own,
            stiffness=own.stiffness * np.where(own.torsion, s**3, s),
            value=own.value * np.where((own.component > 2) & ~own.torsion[own.spring], s, 1.0),
        )
        for own in mesh.springs
    )
    return replace(mesh, position=s * mesh.position, point_masses=masses, springs=springs)
