"""Strain of the surface at the guess: under each load alone, at rest, and at one instant of the training run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.config.loads import LoadSection
from strainsight.errors import DeckError
from strainsight.experiment.structure.surface import largest_principal
from strainsight.fem.recovery import facet_strain
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training

LEAST = 1e-6
"""Strain that a unit load is made to reach, by thousands of its unit."""
MOST = 10.0**9
"""Of its unit: beyond it a load strains nothing."""


@dataclass(frozen=True)
class SurfaceStrain:
    """Principal strain of largest size, with its sign, of every exterior facet at its middle (f,).

    load: the one that acts alone, "" : all of a training run; size [unit]: of that load; case: the load case of that run, "" as
    stated; instant [s] of that run; free: of a structure that the load accelerates as a whole.
    """

    strain: np.ndarray
    load: str = ""
    size: float = 1.0
    unit: str = ""
    case: str = ""
    instant: float = 0.0
    free: bool = False


def surface_strains(
    mesh: Mesh, reduced: Reduced, training: Training, loads: Mapping[str, LoadSection], free: bool = False
) -> tuple[SurfaceStrain, ...]:
    """ε = B Ψ q at the guess, of every load alone and of every training run at one instant; none where nothing is solid.

    A load alone: q = K⁻¹ S u at rest, u one of its unit, or as many thousands of it as reach 1 µm/m; of a `free` structure
    (mesh.free) with the inertia of its rigid acceleration, of matrices that leave it loose none.
    A run: its coordinates at the instant of its largest strain energy ½ qᵀKq.
    """
    if not mesh.has_surface:
        return ()
    try:
        rows = facet_strain(mesh, exterior_facets(mesh)).matrix @ reduced.basis
    except DeckError:  # elements whose own modes need a Poisson ratio, of a model that came as matrices
        return ()
    model = reduced.model
    K = model.stiffness.at(model.reference)

    def at(q: np.ndarray) -> np.ndarray:
        return largest_principal((rows @ q).reshape(-1, 6))

    found = []
    for name, q in zip(model.inputs, _at_rest(K, model.input_shape), strict=False):
        strain, size = at(q), 1.0
        while size < MOST and size * np.abs(strain).max(initial=0.0) < LEAST:
            size *= 1000.0
        if size < MOST:
            found.append(SurfaceStrain(size * strain, name, size, loads[name].unit, free=free))
    for case in sorted(training.cases) or [""]:
        run = training.motion_in(case)
        k = int(np.argmax(np.einsum("ti,ij,tj->t", run.coordinate, K, run.coordinate, optimize=True)))
        found.append(SurfaceStrain(at(run.coordinate[k]), case=case, instant=float(run.time[k])))
    return tuple(found)


def _at_rest(K: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """q (inputs, r) under each load alone; none where K is singular."""
    if np.linalg.cond(K) > 1 / np.finfo(float).eps:
        return np.empty((0, len(K)))
    return np.linalg.solve(K, shape).T
