"""Gauges that a bench's flexible body could carry, and those worth an exact ranking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest

import numpy as np

from strainsight.config.bench.place import BenchPlace
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.layout.zones import zone_of
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import Candidates, candidates, concatenate
from strainsight.sensors.principal import ROSETTE, principal_angles
from strainsight.sensors.rows import channel_rows
from strainsight.sensors.screening import screen, strongest_first

UNFELT = 1e-12
"""Share of the strongest input's strain below which that of another is rounding."""


@dataclass(frozen=True)
class GaugePool:
    """candidates, m of them, a gauge each, those that are bonded already first; rows (m, r) strain per coordinate of the body;
    response (poses, m, nu) reading per unit of every unknown input, at rest; kept (p,) ascending: which enter the elimination;
    names (m,): of sensors of the bench that stand behind the gauges, which have none; price (m,)."""

    candidates: Candidates
    rows: np.ndarray
    response: np.ndarray
    kept: np.ndarray
    names: tuple[str, ...]
    price: np.ndarray


def gauge_pool(
    mesh: Mesh, basis: np.ndarray, static: np.ndarray, inputs: Sequence[str], place: BenchPlace
) -> GaugePool:
    """Every candidate that `place` of a bench allows, and the strongest under each input in each pose in turn, so far apart as
    it says.

    basis (3 nodes, r) displacement per coordinate; static (poses, r, nu) coordinates per unit of every unknown input, at rest;
    inputs: their names.
    One measure of strength for all inputs would keep what sees the strongest, and none for a load along the blade.
    Raises InfeasibleError where no facet is left, or an input strains none of them.
    """
    facets, key = exterior_facets(mesh), "place"
    include, exclude = ([zone_of(entry) for entry in zones] for zones in (place.include, place.exclude))
    axis, turn = place.direction.axis if place.direction.type == "axis" else None, None
    zoned = partial(candidates, exclude=exclude, surface=place.surface, include=include, key=key)
    with blame("place.surface"):
        if axis is None:
            base = zoned(mesh, facets, None, ROSETTE, rosette=True)
            rows = channel_rows(mesh.position, base, basis, facets=facets)
            alike = np.hstack(static / _strength(rows @ static, inputs))
            turn = principal_angles(rows.reshape(-1, len(ROSETTE), basis.shape[1]), alike @ alike.T)
        pool = concatenate([_bonded(mesh, facets, place), zoned(mesh, facets, axis, place.direction.angles, turn=turn)])
    rows = channel_rows(mesh.position, pool, basis, facets=facets)
    response = rows @ static
    size = np.abs(response) / _strength(response, inputs)
    free, there = np.flatnonzero(~pool.bonded), np.flatnonzero(pool.bonded)
    with blame("place.spacing"):
        columns = np.hstack(size).T
        ranked = [free[_ranked(column[free], pool.position[free], float(place.spacing))] for column in columns]
    in_turn = dict.fromkeys(int(gauge) for turn in zip_longest(*ranked) for gauge in turn if gauge is not None)
    kept = [*there.tolist(), *list(in_turn)[: int(place.pool)]]
    price = np.where(pool.bonded, 0.0, float(place.price))
    return GaugePool(pool, rows, response, np.array(sorted(kept)), ("",) * len(pool), price)


def _bonded(mesh: Mesh, facets: Facets, place: BenchPlace) -> Candidates:
    """The gauges that are there already, each grid of a rosette a gauge of its own."""
    entries = [BondedEntry(e.position, e.direction, float(e.length or 0.0), e.angles) for e in place.fixed]
    there, _ = bonded(mesh, facets, entries, float(place.snap_tolerance), "place.fixed")
    return replace(there, gauge=np.arange(len(there)))


def _ranked(strength: np.ndarray, position: np.ndarray, spacing: float) -> np.ndarray:
    """Candidates that far apart, the strongest first."""
    found = screen(strength, 1.0, position, None, spacing)
    return found.kept[strongest_first(found.snr[found.kept])]


def _strength(response: np.ndarray, inputs: Sequence[str]) -> np.ndarray:
    """Largest strain under every input (nu,) in any pose, response (poses, m, nu)."""
    largest = np.abs(response).max(axis=(0, 1))
    lost = [name for name, size in zip(inputs, largest, strict=True) if size <= UNFELT * largest.max(initial=0.0)]
    if lost:
        raise InfeasibleError(
            f"{', '.join(lost)} strain{'s' * (len(lost) == 1)} no candidate",
            key="place.body",
            remedy="place gauges on a body that carries them, take poses in which they show, or take them out of estimate",
        )
    return np.asarray(largest)
