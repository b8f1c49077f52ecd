"""Gauges that a bench's flexible body could carry, and those worth an exact ranking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from strainsight.config.bench.bench import (
    AccelerationSensor,
    BenchConfig,
    BenchPlace,
    MotionSensor,
    RelativeSensor,
    StrainSensor,
)
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.problem import BenchUnknowns, asked
from strainsight.experiment.bench.layout.strained import Known
from strainsight.experiment.bench.loads import loads_of
from strainsight.experiment.bench.sensors import motion_sensor, tolerances_of_gauges
from strainsight.experiment.layout.gauge_list import zone_of
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.multibody.accelerations import at_rest, measured
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.multibody.inverse.parameters import static_response
from strainsight.multibody.sensors import axis_sensor, position_sensor, readings
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import (
    ACCELERATION,
    DISPLACEMENT,
    ROSETTE,
    Candidates,
    candidates,
    concatenate,
    principal_angles,
)
from strainsight.sensors.installation import SECOND, sensitivity_rows
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


AXES = "xyz"


@dataclass(frozen=True)
class MotionCandidates:
    """candidates, k of them, on no facet; names, of each "sensor.axis"; noise (k,) [m or m/s²]; price (k,); rows: of every pose
    (k, n*) on (η, η̇, unknowns), as `LinearBench.readings`; still (poses, k, n): what they read of q alone, where nothing
    accelerates; white (poses, k): variance of a reading by the white force in a step for 1 m/s² of it; peak (k,): the largest
    reading at rest."""

    candidates: Candidates
    names: tuple[str, ...]
    noise: np.ndarray
    price: np.ndarray
    rows: tuple[np.ndarray, ...]
    still: np.ndarray
    white: np.ndarray
    peak: np.ndarray


def motion_candidates(
    config: BenchConfig,
    bench: Bench,
    place: BenchPlace,
    poses: Sequence[tuple[np.ndarray, np.ndarray]],
    benches: Sequence[LinearBench],
    inputs: Sequence[int],
    by_xi: np.ndarray,
) -> MotionCandidates:
    """Those of `place.sensors`, in poses (q, u) at rest; inputs: places of the unknown loads; by_xi (nθ, p) ∂θ/∂ξ.

    An accelerometer reads v̇ of the linear bench, so that loads are seen at once, and gravity where it tilts.
    """
    system, names = bench.system, list(place.sensors)
    # accelerometers stand behind the others where sensors are compiled
    names.sort(key=lambda name: isinstance(config.sensors[name], AccelerationSensor))
    own = [motion_sensor(name, config.sensors[name], bench.frames) for name in names]
    compiled = readings(system, own)
    # of a relative motion without its tilts
    starts = np.cumsum([0, *(5 if isinstance(config.sensors[name], RelativeSensor) else 3 for name in names)])[:-1]
    kept = np.concatenate([start + np.arange(3) for start in starts]) if names else np.zeros(0, dtype=int)
    none, H, still, white, peak = np.zeros(len(system.drives.names)), [], [], [], []
    for (q, u), linear in zip(poses, benches, strict=True):
        found = measured(system, compiled, q, np.zeros_like(q), u, bench.theta, none)
        columns = (found.by_q @ linear.T, found.by_v @ linear.T, found.by_u[:, list(inputs)], found.by_theta @ by_xi)
        H.append(np.hstack(columns)[kept])
        still.append(compiled.read(q, np.zeros_like(q), at_rest(system, u))[1][kept])
        shaken = np.zeros(len(found.y))
        if compiled.accelerometers:
            by_a = compiled.accelerations(q, np.zeros_like(q), at_rest(system, u))[3]
            shaken[compiled.accelerated] = ((by_a @ linear.T @ linear.T.T) ** 2) @ linear.force
        white.append(shaken[kept])
        peak.append(np.abs(found.y[kept]))
    entries = [place.sensors[name] for name in names]
    noise = np.concatenate([np.broadcast_to(np.asarray(own.noise, dtype=float), 3) for own in entries] or [np.zeros(0)])
    return MotionCandidates(
        _candidates(config, bench, names, poses[0][0]),
        tuple(f"{name}.{axis}" for name in names for axis in AXES),
        noise,
        np.repeat([float(own.price) for own in entries], 3),
        tuple(H),
        np.array(still),
        np.array(white),
        np.max(peak, axis=0),
    )


def _candidates(config: BenchConfig, bench: Bench, names: Sequence[str], q: np.ndarray) -> Candidates:
    """Where they are and along what, at q."""
    place, direction, quantity = np.zeros((0, 3)), np.zeros((0, 3)), []
    for name in names:
        entry = config.sensors[name]
        assert isinstance(entry, RelativeSensor | MotionSensor | AccelerationSensor)
        at, along = entry.frames[::-1] if isinstance(entry, RelativeSensor) else (entry.frame, entry.frame)
        axes = [axis_sensor(name, bench.frames[along], k) for k in range(3)]
        y = readings(bench.system, [position_sensor(name, bench.frames[at]), *axes]).read(q, np.zeros_like(q))[0]
        turns = isinstance(entry, RelativeSensor) or (isinstance(entry, AccelerationSensor) and entry.axes == "own")
        place = np.vstack([place, np.tile(y[:3], (3, 1))])
        direction = np.vstack([direction, y[3:].reshape(3, 3) if turns else np.eye(3)])
        quantity += [ACCELERATION if isinstance(entry, AccelerationSensor) else DISPLACEMENT] * 3
    count = len(place)
    none = np.zeros(count, dtype=np.int64)
    return Candidates(
        element=none,
        facet=none,
        kind=np.full(count, -1),
        nodes=np.full((count, 8), -1),
        position=place,
        normal=np.zeros((count, 3)),
        direction=direction,
        angle=np.zeros(count),
        local=np.zeros((count, 2)),
        quantity=np.array(quantity, dtype=np.int64),
        gauge=np.arange(count),
    )


def known_of(
    config: BenchConfig, unknowns: BenchUnknowns, bench: Bench, loads: Sequence[str], h: float, time: np.ndarray
) -> tuple[Known | None, np.ndarray]:
    """What parameters add to a placement, None without any; and σ (unknowns,) of the change in a step h [s] that gauges are
    ranked with, loads in the order given before ξ: as stated, of a constant one as much as leads to σ of its guess over the run.

    The run is in each pose from half-way to the one before until half-way to the next; time (poses,) [s].
    """
    order = [list(asked(config).inputs).index(name) for name in loads]
    of_loads = unknowns.increment_u[order]
    if not unknowns.free:
        return None, of_loads
    coordinates, theta = unknowns.coordinates, bench.theta
    length = float(asked(config).duration or config.simulate.duration)
    between = np.concatenate([[0.0], 0.5 * (time[1:] + time[:-1]), [length]])
    steps = np.maximum(1, np.diff(np.round(between / h).astype(int)))
    covariance = coordinates.covariance(theta, unknowns.std)
    moved = np.sqrt(np.diag(coordinates.covariance(theta, unknowns.increment)))
    known = Known(
        block_diag(np.diag(unknowns.std_u[order]), np.linalg.cholesky(covariance)),
        np.concatenate([of_loads, moved]),
        coordinates.theta(coordinates.xi(theta))[1][coordinates.free],
        tuple(int(count) for count in steps),
    )
    stand_in = np.sqrt(np.diag(covariance) / steps.sum())
    return known, np.concatenate([of_loads, np.where(moved > 0, moved, stand_in)])


def zeroed(config: BenchConfig) -> bool:
    """Whether the filter has the layout by a sensor that is zeroed at a start at rest: it tells nothing of what deformed the
    bench then."""
    own = (config.sensors[name] for name in asked(config).sensors)
    takes = any(isinstance(sensor, StrainSensor) and sensor.layout == "place" and sensor.zeroed for sensor in own)
    return takes and config.simulate.start == "equilibrium"


AT_A_TIME = 4000
"""Gauges whose sensitivities are held in memory."""
INSTANTS = 200
"""Of a run, at which its loads are asked."""


def installation_offs(
    config: BenchConfig,
    body: str,
    bench: Bench,
    files: Mapping[str, Path],
    mesh: Mesh,
    basis: np.ndarray,
    gauges: Candidates,
    time: np.ndarray,
    poses: list[tuple[np.ndarray, np.ndarray]],
    zero: np.ndarray,
) -> np.ndarray:
    """√v (poses, m) [strain] of gauges on a body, by `estimate.tolerances`, to first order as the filter has them:

        vⱼ = Σₖ σₖ² mean_t (sₖⱼ (η − η₀))²,     η = η_pose + ∂η/∂u (u(t) − u_pose)

    over as much of the run as is nearest to the pose, quasi-static: what is off with the motion of its modes is left out.
    time (poses,) [s] and poses (q, u); zero (r,): η₀ of gauges that are zeroed, else none. Zeros without tolerances.
    """
    sigma = {
        name: value for name, value in tolerances_of_gauges(config).by_name.items() if value > 0 and name not in SECOND
    }
    v = np.zeros((len(poses), len(gauges)))
    if not sigma:
        return v
    modal = bench.system.modal(body)
    run = np.linspace(0.0, float(asked(config).duration or config.simulate.duration), INSTANTS)
    loads, nearest = loads_of(bench, files)(run), np.abs(run[:, None] - time).argmin(axis=1)
    second: list[np.ndarray] = []
    for k, (q, u) in enumerate(poses):
        change = loads[nearest == k] - u if np.any(nearest == k) else np.zeros((1, len(u)))
        change[:, bench.system.drives.at :] = 0.0  # poses have them
        eta = (q + change @ static_response(bench.system, q, u, bench.theta)[0].T)[:, modal] - zero
        second.append(eta.T @ eta / len(eta))
    skin = exterior_facets(mesh)
    for own in np.array_split(np.arange(len(gauges)), len(gauges) // AT_A_TIME + 1):
        felt = sensitivity_rows(
            mesh.position, gauges.take(own), basis, tolerances_of_gauges(config).position, facets=skin
        )
        for name, value in sigma.items():
            s = value * getattr(felt, name)
            v[:, own] += [np.einsum("mi,ij,mj->m", s, C, s, optimize=True) for C in second]
    return np.asarray(np.sqrt(v))
