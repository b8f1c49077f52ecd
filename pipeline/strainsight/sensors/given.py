"""Candidates by their strain rows, for what this package does not assemble: shells, beams, anything with ready matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.errors import InfeasibleError
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.zones import Zone, inside


@dataclass(frozen=True)
class GivenGauges:
    """pool (m): element is the gauge's number in the table, facet 0, nodes −1, normal zero, direction unit or zero where
    the table leaves it blank; rows, CSR (m, r) [1/m, 1/rad]: strain per motion of every row of the matrices."""

    pool: Candidates
    rows: sparse.csr_array


def without(given: GivenGauges, mesh: Mesh, facets: Facets | None, zones: Sequence[Zone]) -> GivenGauges:
    """Those outside all zones. Raises InfeasibleError where none is left."""
    keep = np.ones(len(given.pool), dtype=bool)
    for zone in zones:
        keep &= ~inside(zone, mesh, facets, given.pool.position, given.pool.normal)
    if not keep.any():
        raise InfeasibleError(f"none of the {len(keep)} given gauges is left", remedy="smaller zones to exclude")
    index = np.flatnonzero(keep)
    return GivenGauges(given.pool.take(index), given.rows[index])


def given_pool(number: np.ndarray, position: np.ndarray, direction: np.ndarray) -> Candidates:
    """Candidates by their numbers (m,), positions (m, 3) [m] and directions (m, 3) of any length."""
    m = len(number)
    length = np.linalg.norm(direction, axis=1)
    return Candidates(
        element=number,
        facet=np.zeros(m, dtype=np.int64),
        kind=np.full(m, -1),
        nodes=np.full((m, 8), -1),
        position=position,
        normal=np.zeros((m, 3)),
        direction=direction / np.where(length > 0, length, 1.0)[:, None],
        angle=np.zeros(m),
    )
