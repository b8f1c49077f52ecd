"""Composite solids for tests: materials, a mesh of layers in one element, and the same of an element a layer."""


from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.fem.assembly import assemble_stiffness
from strainsight.mesh.anisotropic import Anisotropic, Orientation, orthotropic
from strainsight.mesh.composite_solids import STACKED, CompositeSolid, Layer
from strainsight.mesh.coordinates import BASIC
from strainsight.mesh.model import Material

from ..anisotropy import CONSTANTS, strains, triclinic

CARBON = Anisotropic(0, orthotropic(*CONSTANTS), 1600.0)
SKEW = Anisotropic(0, triclinic(), 1300.0)
STEEL = Material(0, 2.1e11, 0.3, 7850.0)
TIN = Material(0, 4.2e10, 0.3, 7300.0)
DIRECTIONS = [(kind, along) for kind, each in STACKED.items() for along in each]
SHEARED = np.array([[1, 0.2, 0.1], [0, 1, 0.3], [0.1, 0, 1.0]])


def about(axis, degrees):
    """Axes (3, 3) turned about one of them, 0, 1 or 2."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R, a, b = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
    R[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return R


def layered(mesh, layers, along=2, axes=np.eye(3)):  # noqa: B008
    """All of a mesh of layers (thickness, material, angle), turned about their direction from axes."""
    isotropic, anisotropic, found = {}, {}, []
    for i, (t, own, angle) in enumerate(layers, start=1):
        (anisotropic if isinstance(own, Anisotropic) else isotropic)[i] = replace(own, id=i)
        found.append(Layer(i, t, Orientation(replace(BASIC, axes=np.asarray(axes)), about(along, angle))))
    return replace(
        mesh,
        materials=isotropic,
        anisotropic=anisotropic,
        regions={number: replace(own, material=0) for number, own in mesh.regions.items()},
        composites=dict.fromkeys(mesh.regions, CompositeSolid(tuple(found), along)),
    )


def alone(mesh, own):
    """All of a mesh of one anisotropic material along the basic axes."""
    return replace(mesh, materials={}, anisotropic=dict.fromkeys(mesh.regions, own))


def energies(mesh):
    """½ uᵀKu of the unit strains, imposed at all nodes."""
    K = assemble_stiffness(mesh)
    fields = [(mesh.position @ own.T).ravel() for own in strains()]
    return np.array([0.5 * u @ (K @ u) for u in fields])
