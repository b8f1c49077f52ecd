"""A structure of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.model import Mesh
from strainsight.mesh.resized import relations_resized, resized_matrix, with_thin_resized


def scaled(mesh: Mesh, s: float) -> Mesh:
    """The structure s times as large, of the same material: x → s x, sections too, point masses m → s³ m, their inertia → s⁵.

    Stiffness grows with s, that of springs too, mass with s³, frequencies fall with 1/s. Forces of the file stay as they are.
    """
    if s == 1.0:
        return mesh
    masses = tuple(
        replace(
            own,
            mass=s**3 * own.mass,
            offset=s * own.offset,
            inertia=s**5 * own.inertia,
            matrix=resized_matrix(own.matrix, s, s**3),
        )
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
    return replace(
        with_thin_resized(mesh, s, s**3),
        position=s * mesh.position,
        orientations={i: own.resized(s) for i, own in mesh.orientations.items()},
        composites={i: own.resized(s) for i, own in mesh.composites.items()},
        relations=relations_resized(mesh, s),
        point_masses=masses,
        springs=springs,
    )
