"""Candidate positions and directions of gauges, bridge arms and motion sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.edges import spaced
from strainsight.sensors.surface import centres, farthest_axis, tangent, turned, unit_vector
from strainsight.sensors.zones import Zone, admissible


@dataclass(frozen=True)
class Arms:
    """The a arms of bridges, except the first one of each bridge, whose sign is 1.

    channel (a,) of each arm, ascending; sign (a,) sₖ of its strain εₖ in ε_B = Σₖ sₖ εₖ; grid (a): position, each a gauge of
    one grid, because arms are bonded one by one."""

    channel: np.ndarray
    sign: np.ndarray
    grid: Candidates

    def index_of(self, channels: np.ndarray) -> np.ndarray:
        """Arms of some channels (k,), channel after channel."""
        return _ranges(*(np.searchsorted(self.channel, channels, side=side) for side in ("left", "right")))

    def of(self, channels: np.ndarray) -> Arms | None:
        """Arms of some channels (k,), renumbered in their order; None if none of them is a bridge."""
        index = self.index_of(channels)
        if not len(index):
            return None
        count = np.searchsorted(self.channel, channels, side="right") - np.searchsorted(self.channel, channels)
        return Arms(np.repeat(np.arange(len(channels)), count), self.sign[index], self.grid.take(index))


def _ranges(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """All integers from each first up to its last, exclusive."""
    return np.concatenate([np.zeros(0, dtype=np.int64), *map(np.arange, first, last)])


STRAIN, ACCELERATION, DISPLACEMENT = 0, 1, 2
UNITS = ("strain", "m/s^2", "m")
"""Units of these quantities."""

STEEPEST = 10.0
"""Smallest angle [deg] between an axis and a facet normal for a reliable projection."""


def _unset() -> np.ndarray:
    return np.zeros(0)


def units_in_words(quantity: np.ndarray) -> str:
    """The unit of an array over channels of these quantities: "strain", or "strain or m/s^2" where they differ."""
    return " or ".join(UNITS[kind] for kind in np.unique(quantity))


def grouped(unit: str) -> str:
    """A unit as a factor of a product: "strain", "(strain or m)"."""
    return f"({unit})" if " or " in unit else unit


@dataclass(frozen=True)
class Candidates:
    """Candidate channels, m of them; the channels of a gauge are adjacent.

    element (m,) ids of the file; facet (m,) local number from 1; kind (m,) codes into FACETS, −1 without a facet; nodes (m, 8)
    indices padded with −1; position (m, 3) [m]; normal (m, 3) outward; direction (m, 3) unit, tangent for strain; angle (m,)
    [deg]; local (m, 2) ξ on the facet; length (m,) [m] of the grid that averages the strain, 0: at the point; quantity (m,)
    STRAIN, ACCELERATION or DISPLACEMENT; gauge (m,) number of the gauge, 0, 1, 2 … without gaps; array (m,) number of the family
    in the config; bonded (m,) whether it is already installed.
    Defaults of the fields after angle: point strain gauge at the facet centre, each channel a gauge, of family 0, not bonded.
    arms: the further arms of channels that are bridges; such a channel has the position of its first arm, is a gauge of one
    channel, and measures the sum of its arms. None: every channel is one grid."""

    element: np.ndarray
    facet: np.ndarray
    kind: np.ndarray
    nodes: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    direction: np.ndarray
    angle: np.ndarray
    local: np.ndarray = field(default_factory=_unset)
    length: np.ndarray = field(default_factory=_unset)
    quantity: np.ndarray = field(default_factory=_unset)
    gauge: np.ndarray = field(default_factory=_unset)
    array: np.ndarray = field(default_factory=_unset)
    bonded: np.ndarray = field(default_factory=_unset)
    arms: Arms | None = None

    def __post_init__(self) -> None:
        m = len(self.element)
        plain = {
            "local": centres(self.kind),
            "length": np.zeros(m),
            "quantity": np.full(m, STRAIN),
            "gauge": np.arange(m),
            "array": np.zeros(m, dtype=np.int64),
            "bonded": np.zeros(m, dtype=bool),
        }
        for name, value in plain.items():
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.element)

    @property
    def gauges(self) -> int:
        """Number of gauges."""
        return int(self.gauge[-1]) + 1 if len(self) else 0

    @property
    def first(self) -> np.ndarray:
        """The first channel of every gauge (gauges,)."""
        return np.flatnonzero(np.diff(self.gauge, prepend=-1) != 0)

    def channels(self, gauges: np.ndarray) -> np.ndarray:
        """The channels of some gauges, in the order of those."""
        start, which = np.append(self.first, len(self)), np.asarray(gauges, dtype=np.int64)
        return _ranges(start[which], start[which + 1])

    def take(self, index: np.ndarray) -> Candidates:
        """The channels at `index`, in its order; adjacent channels of one gauge remain one gauge."""
        columns = {name: getattr(self, name)[index] for name in COLUMNS}
        arms = self.arms and self.arms.of(np.arange(len(self))[index])
        columns["gauge"] = np.cumsum(np.diff(columns["gauge"], prepend=columns["gauge"][:1]) != 0)
        return Candidates(**columns, arms=arms)

    @property
    def grids(self) -> Candidates:
        """Every grid as a separate channel (g ≥ m): those of the channels, followed by the further arms of bridges, each a
        gauge."""
        return self if self.arms is None else concatenate([replace(self, arms=None), self.arms.grid])

    @property
    def channel_of_grid(self) -> np.ndarray:
        """The channel (g,) of each of the `grids`."""
        channels = np.arange(len(self))
        return channels if self.arms is None else np.append(channels, self.arms.channel)

    @property
    def sign_of_grid(self) -> np.ndarray:
        """Sign s (g,) of each of the `grids` in the reading of its channel."""
        ones = np.ones(len(self))
        return ones if self.arms is None else np.append(ones, self.arms.sign)

    @property
    def bridged(self) -> np.ndarray:
        """Which channels (m,) are bridges."""
        is_bridge = np.zeros(len(self), dtype=bool)
        if self.arms is not None:
            is_bridge[self.arms.channel] = True
        return is_bridge

    def read(self, rows: np.ndarray) -> np.ndarray:
        """Channel rows (m, …) from rows of their `grids` (g, …): ε_B = Σₖ sₖ εₖ for a bridge."""
        return self._onto(rows, self.sign_of_grid)

    def added(self, values: np.ndarray) -> np.ndarray:
        """The sum (m, …) of values (g, …) over the grids of every channel, regardless of their signs."""
        return self._onto(values, np.ones(len(values)))

    def _onto(self, values: np.ndarray, factor: np.ndarray) -> np.ndarray:
        if self.arms is None:
            return values
        m, factor = len(self), factor.reshape(-1, *(1,) * (values.ndim - 1))
        sums = values[:m].astype(float)
        np.add.at(sums, self.arms.channel, (factor * values)[m:])
        return sums

    def any_grid(self, values: np.ndarray) -> np.ndarray:
        """Which channels (m,) have a true value for one of their `grids` (g,)."""
        return np.asarray(self.added(values) > 0) if self.arms is not None else values

    def grids_of(self, gauges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Indices of all `grids` of some gauges (k,), and of the gauges of these grids, in the order of
        `take(channels(gauges))`."""
        channels = self.channels(gauges)
        if self.arms is None:
            return channels, np.asarray(gauges)
        further = self.arms.index_of(channels)
        return np.append(channels, len(self) + further), np.append(gauges, self.gauges + further)


COLUMNS = tuple(entry.name for entry in fields(Candidates) if entry.name != "arms")
"""Fields of every channel."""


def channels_of_gauges(owner: np.ndarray, gauges: np.ndarray) -> np.ndarray:
    """Channels (..., c) of gauges (...), padded with −1 up to the largest number c; owner (m,) ascending: gauge of every
    channel."""
    first = np.searchsorted(owner, gauges)
    count = np.searchsorted(owner, gauges, side="right") - first
    each = np.arange(int(count.max(initial=1)))
    return np.asarray(np.where(each < count[..., None], first[..., None] + each, -1))


def concatenate(parts: Sequence[Candidates]) -> Candidates:
    """All channels of the parts, with consecutive gauge numbers."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    gauges, channels = (np.cumsum([0, *count]) for count in ([part.gauges for part in parts], map(len, parts)))
    columns["gauge"] = np.concatenate([part.gauge + first for part, first in zip(parts, gauges[:-1], strict=True)])
    bridged = [(part.arms, first) for part, first in zip(parts, channels[:-1], strict=True) if part.arms is not None]
    arms = None
    if bridged:
        arms = Arms(
            np.concatenate([part_arms.channel + first for part_arms, first in bridged]),
            np.concatenate([part_arms.sign for part_arms, _ in bridged]),
            concatenate([part_arms.grid for part_arms, _ in bridged]),
        )
    return Candidates(**columns, arms=arms)


def candidates(
    mesh: Mesh,
    facets: Facets,
    axis: Sequence[float] | None,
    angles: Sequence[float] = (0.0,),
    exclude: Sequence[Zone] = (),
    surface: str = "all",
    on_constraints: bool = False,
    *,
    include: Sequence[Zone] = (),
    rosette: bool = False,
    length: float = 0.0,
    turn: np.ndarray | None = None,
    array: int = 0,
    key: str = "gauges",
) -> Candidates:
    """A gauge at the centre of every admissible exterior facet for every angle α about the outward normal n:

        d₀ ∥ a − (a·n) n,     d = cos α d₀ + sin α n × d₀

    axis a (3,) of any length, or None for the coordinate axis with the largest angle to the normal, facet by facet; angles [deg];
    turn (f,) [deg] is added to the angles of each of the f admitted facets (`principal_angles`); rosette: the angles of a facet
    are one gauge with a channel each, instead of a gauge each; length [m] of the grid. Admissible facets and `key`: see
    `admissible`.
    Raises UserError for a set that does not exist and an axis of zero length, InfeasibleError if no facet remains or the axis is
    within 10° of a facet normal."""
    keep, centre_, normal = admissible(
        mesh, facets, surface=surface, include=include, exclude=exclude, on_constraints=on_constraints, key=key
    )
    n = normal[keep]
    d0 = tangents(n) if axis is None else _projected(axis, facets, keep, n, key)
    base_angles = np.broadcast_to(np.asarray(angles, dtype=float), (keep.size, len(angles)))
    total = base_angles if turn is None else base_angles + np.asarray(turn, dtype=float)[:, None]
    each = np.repeat(keep, len(angles))
    m = len(each)
    return Candidates(
        **facets.columns(each),
        position=centre_[each],
        normal=normal[each],
        direction=turned(np.repeat(d0, len(angles), axis=0), normal[each], total.ravel()),
        angle=base_angles.ravel().copy(),
        length=np.full(m, float(length)),
        gauge=np.repeat(np.arange(keep.size), len(angles)) if rosette else np.arange(m),
        array=np.full(m, array),
    )


def tangents(normal: np.ndarray) -> np.ndarray:
    """A unit tangent (m, 3) for every normal (m, 3): projection of the coordinate axis with the largest angle to it."""
    return tangent(farthest_axis(normal), normal)


def _projected(axis: Sequence[float], facets: Facets, keep: np.ndarray, n: np.ndarray, key: str) -> np.ndarray:
    a = unit_vector(axis, "the gauge axis")
    if (steep := np.abs(n @ a) > np.cos(np.deg2rad(STEEPEST))).any():
        first = keep[np.argmax(steep)]
        raise InfeasibleError(
            f"the gauge axis is within {STEEPEST:g}° of the normal of {np.count_nonzero(steep)} of {keep.size} facets "
            f"(for example element {facets.element_id[first]}, facet {facets.facet[first]}): the projection is undefined",
            key=f"{key}.direction",
            remedy=f"Choose another {key}.direction.axis, restrict {key}.surface, or exclude these facets: "
            f"{key}.exclude: [{{normal_cone: {{axis: [{a[0]:.3g}, {a[1]:.3g}, {a[2]:.3g}], angle: {STEEPEST:g}}}}}].",
        )
    return tangent(np.broadcast_to(a, n.shape), n)


ROSETTE = (0.0, 45.0, 90.0)
"""Angles from any tangent [deg] whose strains determine those of every direction."""
SAMPLES = 64
EQUAL = 1e-6
"""Largest difference of equal mean squares of directions, as a share of the largest (rounding is 1e-10 of it); also the
tolerance [deg] of half a rotation."""


def principal_angles(rows: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Angle (f,) [deg], −90 ≤ φ < 90, at which the mean square of ε(φ) over the run is largest, from 0°, 45° and 90°:

        ε(φ) = a + b cos 2φ + c sin 2φ,     a = ½(ε₀ + ε₉₀),  b = ½(ε₀ − ε₉₀),  c = ε₄₅ − a
        f(ψ) = M_aa + 2 M_ab cos ψ + 2 M_ac sin ψ + M_bb cos² ψ + M_cc sin² ψ + 2 M_bc sin ψ cos ψ,     ψ = 2φ

    M (3, 3) is the mean of [a b c]ᵀ[a b c]. f has at most two maxima; the largest of 64 samples is refined by Newton's method. Of
    equal samples the first is used, and if all directions have equal strain it is 0°.
    rows (f, 3, r) strain of gauges at 0°, 45° and 90° from any tangent, per coordinate; moment (r, r) mean of q qᵀ over the
    run."""
    zero, half, right = np.moveaxis(np.asarray(rows, dtype=float), 1, 0)
    mean = 0.5 * (zero + right)
    parts = np.stack([mean, 0.5 * (zero - right), half - mean], axis=1)
    M = parts @ moment @ np.swapaxes(parts, 1, 2)
    psi = np.linspace(0.0, 2 * np.pi, SAMPLES, endpoint=False)
    basis = np.stack([np.ones(SAMPLES), np.cos(psi), np.sin(psi)])
    f = np.einsum("ap,fab,bp->fp", basis, M, basis)
    size = np.maximum(np.abs(f).max(axis=1), np.finfo(float).tiny)
    # rounding must not choose between equal directions
    x = psi[np.argmax(f >= (f.max(axis=1) - EQUAL * size)[:, None], axis=1)]
    moves = np.ptp(f, axis=1) > EQUAL * size
    p, q, r, s = 2 * M[:, 0, 2], -2 * M[:, 0, 1], 2 * M[:, 1, 2], M[:, 2, 2] - M[:, 1, 1]
    for _ in range(20):
        slope = p * np.cos(x) + q * np.sin(x) + r * np.cos(2 * x) + s * np.sin(2 * x)
        bend = -p * np.sin(x) + q * np.cos(x) - 2 * r * np.sin(2 * x) + 2 * s * np.cos(2 * x)
        # ascend where the curve is not yet concave, but never past the neighbouring samples
        step = np.where(bend < -1e-12 * size, -slope / np.where(bend < 0, bend, -1.0), np.sign(slope) * 0.01)
        step = np.where(moves & (np.abs(slope) > 1e-14 * size), step, 0.0)
        x = x + np.clip(step, -np.pi / SAMPLES, np.pi / SAMPLES)
    turn = (np.rad2deg(x / 2) + 90.0) % 180.0
    return np.where(turn > 180.0 - EQUAL, 0.0, turn) - 90.0


Axis = Literal["normal"] | Sequence[float]


def motion_candidates(
    mesh: Mesh,
    facets: Facets,
    quantity: int,
    axes: Sequence[Axis] = ("normal",),
    *,
    surface: str = "all",
    include: Sequence[Zone] = (),
    exclude: Sequence[Zone] = (),
    on_constraints: bool = False,
    every: float | None = None,
    array: int = 1,
    key: str = "motion_sensors",
) -> Candidates:
    """One motion sensor at the centre of every admissible exterior facet, with a channel for each axis.

    quantity ACCELERATION or DISPLACEMENT; axes: "normal", outward, or a direction (3,) of any length in global coordinates;
    every [m]: facets nearer than this to the centre of an earlier one are skipped. Admissible facets and `key`: see `admissible`.
    Raises UserError for a set that does not exist and an axis of zero length, InfeasibleError if no facet remains."""
    keep, centre, normal = admissible(
        mesh, facets, surface=surface, include=include, exclude=exclude, on_constraints=on_constraints, key=key
    )
    if every is not None:
        keep = keep[spaced(centre[keep], every)]
    each = np.repeat(keep, len(axes))
    return Candidates(
        **facets.columns(each),
        position=centre[each],
        normal=normal[each],
        direction=np.stack([_direction(axis, normal[keep], key) for axis in axes], axis=1).reshape(-1, 3),
        angle=np.zeros(len(each)),
        quantity=np.full(len(each), quantity),
        gauge=np.repeat(np.arange(len(keep)), len(axes)),
        array=np.full(len(each), array),
    )


def _direction(axis: Axis, normal: np.ndarray, key: str) -> np.ndarray:
    if isinstance(axis, str):
        return normal
    remedy = 'Specify three numbers, not all zero, or "normal".'
    return np.broadcast_to(unit_vector(axis, "the sensor axis", key=f"{key}.axes", remedy=remedy), normal.shape)
