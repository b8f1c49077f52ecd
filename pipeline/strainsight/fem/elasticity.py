"""Stiffness of anisotropic materials along the basic axes, at points of a mesh."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.model import Mesh

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""Components of a symmetric tensor in our order, that of VTK: xx yy zz xy yz zx."""


def pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """½(a bᵀ + b aᵀ) (m, 6) of a and b (m, 3), as stress: xx yy zz xy yz zx."""
    return np.stack([0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i]) for i, j in PAIRS], axis=1)


def turned(C: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """C along the basic axes (m, 6, 6) of C (6, 6) or (m, 6, 6) along others, axes (m, 3, 3) one in a column:

        C' = R C Rᵀ,     σ' = R σ,   ε = Rᵀ ε',   γ = 2ε

    so that column k of R is the stress tensor a_i ⊗ a_j, made symmetric and of the shears twice, of the k-th pair of axes.
    """
    columns = [(1.0 if i == j else 2.0) * pair(axes[:, :, i], axes[:, :, j]) for i, j in PAIRS]
    R = np.stack(columns, axis=2)
    return np.asarray(R @ C @ R.swapaxes(1, 2))


def anisotropic_regions(mesh: Mesh) -> list[int]:
    """Ids of the regions of solids whose material is anisotropic, ascending."""
    return sorted(number for number in mesh.regions if mesh.anisotropic_of(number) is not None)


def varies(mesh: Mesh, region: np.ndarray) -> bool:
    """Whether an anisotropic material of some regions (ids) has axes that vary from point to point."""
    own = {int(number) for number in np.unique(region)} & set(mesh.orientations)
    return any(mesh.orientations[number].varies for number in own)


def elasticity_at(mesh: Mesh, region: np.ndarray, position: np.ndarray) -> np.ndarray:
    """C (m, 6, 6) [Pa] along the basic axes at positions (m, 3) [m] in regions (m,) of anisotropic materials."""
    C = np.empty((len(region), 6, 6))
    for number in np.unique(region).tolist():
        own, at, material = mesh.orientations.get(number), region == number, mesh.anisotropic_of(number)
        assert material is not None
        C[at] = material.stiffness if own is None else turned(material.stiffness, own.axes_at(position[at]))
    return C
