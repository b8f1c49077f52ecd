"""What whoever bonds a gauge has to know of its place: how fast the strain changes there, and whether a hand gets at it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.experiment.structure.contact import held_below
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.placed import AtGauges
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.sensors.access import room
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.misplaced import installation_axes
from strainsight.sensors.sensitivity import sensitivity_rows
from strainsight.sensors.walk import Skin, skin_of

IN_PLACE, OVER_GRID = 0.05, 0.2
"""Of a reading: what a σ of its place may change of it, and what the strain may change from end to end of its grid. Ours: on
smooth parts 2 mm are 1 to 1.5 %; of what is linear over a grid the mean is read, and nothing of it is wrong."""
HAND = 0.06
"""[m] of free height that a hand with a foil, a pad and a clamp takes: ours."""
STEP = 0.001
"""[m] σ at which slopes are taken where the place has no tolerance."""


def at_gauges(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, training: Training, gauges: np.ndarray
) -> AtGauges | None:
    """Of gauges by their numbers (k,), along the training run; None where they are given without a surface.

    With the slopes s₁, s₂ of a grid's strain in its place, along e₁ and e₂, ε its strain and t the time:

        in place      √(σ² Σ (rms_t s₁² + rms_t s₂²)) / rms_t ε        of a gauge that is still to be bonded
        over grid     L rms_t (d₁ s₁ + d₂ s₂) / rms_t ε                d its direction, L its length

    Of a bridge the sum is over its arms, and the largest of them counts over the grid; of a rosette the channel that changes
    most; rms ε is that of the largest channel. NaN where no strain is measured.
    """
    if training.given is not None or not mesh.has_surface:
        return None
    pool, std = training.candidates, float(tolerances_of(config.tolerances).position)
    part = pool.take(pool.channels(gauges))
    skin = skin_of(mesh.position, exterior_facets(mesh))
    in_place, over_grid = _steep(mesh, reduced, training, part, std, skin)
    grids = part.grids
    owner = part.gauge[part.channel_of_grid]
    height = np.full(part.gauges, np.inf)
    np.minimum.at(height, owner[grids.first], room(skin, grids, HAND))
    lies_on = [""] * part.gauges
    for gauge, words in zip(owner, held_below(mesh, skin.facets, grids), strict=True):
        lies_on[gauge] = lies_on[gauge] or words
    return AtGauges(
        in_place=in_place,
        over_grid=over_grid,
        room=height,
        lies_on=tuple(lies_on),
        in_place_limit=IN_PLACE,
        over_grid_limit=OVER_GRID,
        room_limit=HAND,
    )


def _steep(
    mesh: Mesh, reduced: Reduced, training: Training, part: Candidates, std: float, skin: Skin
) -> tuple[np.ndarray, np.ndarray]:
    """Change in place and over the grid (gauges,) of every gauge."""
    grids, C = part.grids, training.moment
    slopes = sensitivity_rows(mesh.position, part, reduced.basis, std or STEP, facets=skin)
    e1, e2 = (axis[grids.gauge] for axis in installation_axes(grids))
    d1, d2 = (np.sum(grids.direction * e, axis=1)[:, None] for e in (e1, e2))

    def square(rows: np.ndarray) -> np.ndarray:
        # of what does not move in training, rounding of either sign is left
        return np.asarray(np.maximum(np.einsum("mi,ij,mj->m", rows, C, rows, optimize=True), 0.0))

    moved = std**2 * (square(slopes.along) + square(slopes.across)) * ~grids.bonded
    ends = grids.length * np.sqrt(square(d1 * slopes.along + d2 * slopes.across))
    size = np.zeros(part.gauges)
    np.maximum.at(size, part.gauge, np.sqrt(square(part.read(slopes.gain))))
    in_place, over_grid = np.zeros(part.gauges), np.zeros(part.gauges)
    np.maximum.at(in_place, part.gauge, np.sqrt(part.added(moved)))
    np.maximum.at(over_grid, part.gauge[part.channel_of_grid], ends)
    known = (part.quantity[part.first] == STRAIN) & (size > 0)
    share = np.where(known, 1 / np.where(size > 0, size, 1.0), np.nan)
    return in_place * share, over_grid * share


def notes_at_gauges(found: AtGauges | None, count: int) -> tuple[str, ...]:
    """What is to be looked at of every gauge of `count`, for its line in a list: empty where there is nothing."""
    if found is None:
        return ("",) * count
    return tuple("; ".join(filter(None, (found.steep_in_words(i), found.access_in_words(i)))) for i in range(count))


def advice_at_gauges(found: AtGauges | None, labels: Sequence[str], bonded: Sequence[bool]) -> Iterator[str]:
    """A sentence for each gauge in a steep gradient, and for those to which access is to be checked alike, as on one face."""
    if found is None:
        return
    alike: dict[str, list[str]] = {}
    for i, label in enumerate(labels):
        if said := found.steep_in_words(i):
            remedy = "" if bonded[i] else ": place it by a template, take a shorter grid, or move it"
            yield f"{label}, {said}{remedy}."
        if not bonded[i]:
            for said in found.access(i):
                alike.setdefault(said, []).append(label)
    for said, own in alike.items():
        yield (
            f"{', '.join(own)}, check access: {said}: see whether a hand gets there, or leave the place out (gauges.exclude)."
        )
