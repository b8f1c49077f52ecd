"""Candidate gauges and sensors of a bench, and the pool for placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, BenchPlace, MotionSensor, RelativeSensor
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.layout.expectation import PlacedBody, Pose
from strainsight.experiment.bench.loads import loads_of
from strainsight.experiment.bench.sensors import frame_at, linear_tolerances, motion_sensor, tolerances_of_gauges
from strainsight.experiment.layout.gauge_list import strain_candidates
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.multibody.accelerations import at_rest, measure
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.multibody.inverse.parameters import static_response
from strainsight.multibody.sensors import readings
from strainsight.sensors.bonded import BondedEntry, bonded, imported_pool
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, Candidates, concatenate
from strainsight.sensors.installation import sensitivity_rows
from strainsight.sensors.screening import screen, strongest_first
from strainsight.sensors.strain_operator import channel_rows

UNFELT = 1e-12
"""Strain relative to that of the strongest input below which it is a rounding error."""


@dataclass(frozen=True)
class CandidatePool:
    """m candidates: gauges, then components of bench sensors.

    names (m,): "sensor.axis", "" for a gauge; price (m,); noise (m,): σ of a sample [unit of each]; readings: of every pose (m,
    n*) on (η, η̇, unknowns); response (poses, m, unknowns): at rest, per unit; peak (m,): largest reading at rest; white (poses,
    m): variance by the white force for 1 m/s²; off (poses, m): σ of the installation error; selected (p,): pool, ascending."""

    candidates: Candidates
    names: tuple[str, ...]
    price: np.ndarray
    noise: np.ndarray
    readings: tuple[np.ndarray, ...]
    response: np.ndarray
    peak: np.ndarray
    white: np.ndarray
    off: np.ndarray
    selected: np.ndarray

    def with_more(self, more: CandidatePool) -> CandidatePool:
        """Append another pool."""
        first = len(self.candidates)
        joined = {key: np.append(getattr(self, key), getattr(more, key)) for key in ("price", "noise", "peak")}
        joined |= {
            key: np.concatenate([getattr(self, key), getattr(more, key)], axis=1)
            for key in ("response", "white", "off")
        }
        return CandidatePool(
            candidates=concatenate([self.candidates, more.candidates]) if len(more.candidates) else self.candidates,
            names=(*self.names, *more.names),
            readings=tuple(np.vstack(pair) for pair in zip(self.readings, more.readings, strict=True)),
            selected=np.append(self.selected, first + more.selected),
            **joined,
        )


def gauge_pool(
    body: PlacedBody,
    time: np.ndarray,
    poses: Sequence[Pose],
    benches: Sequence[LinearBench],
    zero: np.ndarray,
    zero_slope: np.ndarray,
) -> CandidatePool:
    """Candidate gauges of `place`, bonded gauges first, and a pool of the strongest under each input and pose in turn, with
    minimum spacing.

    time (poses,) [s]; for zeroed gauges: zero (r,): η at zeroing, zero_slope (r, unknowns): its change per unit of every unknown.
    Raises InfeasibleError if no facet is left, or an input causes no strain."""
    mesh, basis, place, inputs, modal = body.mesh, body.basis, body.place, body.inputs, body.modal
    facets, static = exterior_facets(mesh), np.array([linear.static[modal] for linear in benches]) - zero_slope

    def moment(rows: np.ndarray) -> np.ndarray:
        normalised = np.hstack(static / _strength(rows @ static, inputs))
        return np.asarray(normalised @ normalised.T)

    with blame("place.surface"):
        gauges = strain_candidates(mesh, facets, place, place.direction, basis, moment, "place")
        pool = concatenate([_bonded(mesh, facets, place), gauges])
    rows = channel_rows(mesh.position, pool, basis, facets=facets)
    response = rows @ static
    size = np.abs(response) / _strength(response, inputs)
    free = np.flatnonzero(~pool.bonded)
    with blame("place.spacing"):
        columns = np.hstack(size).T
        ranked = [free[_ranked(column[free], pool.position[free], float(place.spacing))] for column in columns]
    in_turn = dict.fromkeys(int(gauge) for turn in zip_longest(*ranked) for gauge in turn if gauge is not None)
    selected = [*np.flatnonzero(pool.bonded).tolist(), *list(in_turn)[: int(place.pool)]]
    for linear in benches:
        _refuse_sizes(body, linear, np.abs(response).max(axis=0)[:, : len(body.loads)])
    on_system = np.zeros((len(rows), body.bench.system.size))
    on_system[:, modal] = rows
    readings = tuple(linear.readings(on_system) for linear in benches)
    for H, linear in zip(readings, benches, strict=True):
        H[:, 2 * len(linear.stiffness) :] -= rows @ zero_slope
    return CandidatePool(
        candidates=pool,
        names=("",) * len(pool),
        price=np.where(pool.bonded, 0.0, float(place.price)),
        noise=np.full(len(rows), float(place.noise)),
        readings=readings,
        response=response,
        peak=np.max([np.abs(rows @ q[modal]) for q, _ in poses], axis=0),
        white=np.zeros((len(benches), len(rows))),
        off=installation_offs(body, pool, time, poses, zero),
        selected=np.array(sorted(selected)),
    )


def _bonded(mesh: Mesh, facets: Facets, place: BenchPlace) -> Candidates:
    """Bonded gauges, with each grid of a rosette as a separate gauge."""
    entries = [BondedEntry(e.position, e.direction, float(e.length or 0.0), e.angles) for e in place.fixed]
    grids, _ = bonded(mesh, facets, entries, float(place.snap_tolerance), "place.fixed")
    return replace(grids, gauge=np.arange(len(grids)))


def _ranked(strength: np.ndarray, position: np.ndarray, spacing: float) -> np.ndarray:
    """Candidates with minimum spacing, the strongest first."""
    screening = screen(strength, 1.0, position, None, spacing)
    return screening.kept[strongest_first(screening.snr[screening.kept])]


def _strength(response: np.ndarray, inputs: Sequence[str]) -> np.ndarray:
    """Largest strain under every input (nu,) in any pose; response (poses, m, nu)."""
    largest = np.abs(response).max(axis=(0, 1))
    lost = [name for name, size in zip(inputs, largest, strict=True) if size <= UNFELT * largest.max(initial=0.0)]
    if lost:
        raise InfeasibleError(
            f"{', '.join(lost)} cause{'s' * (len(lost) == 1)} no strain at any candidate gauge",
            key="place.body",
            remedy="Choose a body that these unknowns strain, set other place.poses, or remove these unknowns from `estimate`.",
        )
    return np.asarray(largest)


FELT = (1e-6, 1e6)
"""Range of the largest effect of one increment of an input, in σ of the noise; the Riccati equation fails at 1e-8 and 1e8."""
PERIODS = (1e-6, 1e6)
"""Range of periods per step, of the last and of the first mode."""


def _refuse_sizes(body: PlacedBody, linear: LinearBench, response: np.ndarray) -> None:
    """Raises InfeasibleError if increments, noise or time step differ by too many orders of magnitude.
    response (m, nu): strain per unit of every unknown load, at rest."""
    noise = float(body.place.noise)
    felt = np.abs(response).max(axis=0) * linear.increment[: len(body.loads)] / noise
    for name, share in zip(body.loads, felt, strict=True):
        if not FELT[0] <= share <= FELT[1]:
            raise InfeasibleError(
                f"a change of {name} by its `increment` changes the reading of the most sensitive gauge by {share:.2g} "
                f"times the noise of {noise:g}; this ratio must be {FELT[0]:g} to {FELT[1]:g}",
                key="place.noise",
                remedy=f"Check place.noise (1 µm/m is 1e-6), estimate.inputs.{name}.increment and the moduli of the bodies.",
            )
    first, last = np.sqrt(np.maximum(linear.stiffness[[0, -1]], 0.0)) / (2 * np.pi)
    for name, mode, bad in (
        ("last", last, last * linear.h < PERIODS[0]),
        ("first", first, first * linear.h > PERIODS[1]),
    ):
        if bad and mode:
            raise InfeasibleError(
                f"the time step of {linear.h:g} s is {mode * linear.h:.2g} periods of the {name} mode ({mode:.3g} Hz); the "
                f"number of periods must be {PERIODS[0]:g} to {PERIODS[1]:g}",
                key="bodies",
                remedy="Check length and mass units, moduli and densities of the bodies, and the time step [s].",
            )


AXES = "xyz"


def motion_pool(body: PlacedBody, poses: Sequence[Pose], benches: Sequence[LinearBench]) -> CandidatePool:
    """Candidates of `place.sensors` in poses at rest, all of which enter the elimination.

    An accelerometer reads v̇ of the linear bench, which includes direct feed-through of loads, and gravity by tilt."""
    config, bench, place, (inputs, by_xi) = body.config, body.bench, body.place, body.columns
    system, names = bench.system, list(place.sensors)
    # compiled sensors have accelerometers last
    names.sort(key=lambda name: isinstance(config.sensors[name], AccelerationSensor))
    compiled = readings(system, [motion_sensor(name, config.sensors[name], bench.frames) for name in names])
    # tilts of a relative motion are omitted
    starts = np.cumsum([0, *(5 if isinstance(config.sensors[name], RelativeSensor) else 3 for name in names)])[:-1]
    components = np.concatenate([np.zeros(0, dtype=int), *(start + np.arange(3) for start in starts)])
    none, H, response, white, peak = np.zeros(len(system.drives.names)), [], [], [], []
    for (q, u), linear in zip(poses, benches, strict=True):
        read = measure(system, compiled, q, np.zeros_like(q), u, bench.theta, none)
        columns = (read.by_q @ linear.T, read.by_v @ linear.T, read.by_u[:, inputs], read.by_theta @ by_xi)
        H.append(np.hstack(columns)[components])
        # no acceleration at rest
        response.append(compiled.read(q, np.zeros_like(q), at_rest(system, u))[1][components] @ linear.static)
        shaken = np.zeros(len(read.y))
        if compiled.accelerometers:
            by_a = compiled.accelerations(q, np.zeros_like(q), at_rest(system, u))[3]
            shaken[compiled.accelerated] = ((by_a @ linear.T @ linear.T.T) ** 2) @ linear.force
        white.append(shaken[components])
        peak.append(np.abs(read.y[components]))
    entries = [place.sensors[name] for name in names]
    noise = [np.broadcast_to(np.asarray(entry.noise, dtype=float), 3) for entry in entries]
    return CandidatePool(
        candidates=_candidates(config, bench, names, poses[0][0]),
        names=tuple(f"{name}.{axis}" for name in names for axis in AXES),
        price=np.repeat([float(entry.price) for entry in entries], 3),
        noise=np.concatenate(noise or [np.zeros(0)]),
        readings=tuple(H),
        response=np.array(response),
        peak=np.max(peak, axis=0),
        white=np.array(white),
        off=np.zeros((len(poses), len(components))),
        selected=np.arange(len(components)),
    )


def _candidates(config: BenchConfig, bench: Bench, names: Sequence[str], q: np.ndarray) -> Candidates:
    """Positions and directions of bench sensors at q."""
    place, direction, quantity = np.zeros((0, 3)), np.zeros((0, 3)), []
    for name in names:
        entry = config.sensors[name]
        assert isinstance(entry, RelativeSensor | MotionSensor | AccelerationSensor)
        at, along = entry.frames[::-1] if isinstance(entry, RelativeSensor) else (entry.frame, entry.frame)
        turns = isinstance(entry, RelativeSensor) or (isinstance(entry, AccelerationSensor) and entry.axes == "own")
        axes = frame_at(bench, bench.frames[along], q)[0][3:].reshape(3, 3) if turns else np.eye(3)
        place = np.vstack([place, np.tile(frame_at(bench, bench.frames[at], q)[0][:3], (3, 1))])
        direction = np.vstack([direction, axes])
        quantity += [ACCELERATION if isinstance(entry, AccelerationSensor) else DISPLACEMENT] * 3
    pool = imported_pool(np.zeros(len(place), dtype=np.int64), place, direction)
    return replace(pool, quantity=np.array(quantity, dtype=np.int64))


AT_A_TIME = 4000
"""Gauges whose sensitivities are in memory at a time."""
INSTANTS = 200
"""Instants of a run at which its loads are evaluated."""


def installation_offs(
    body: PlacedBody, gauges: Candidates, time: np.ndarray, poses: Sequence[Pose], zero: np.ndarray
) -> np.ndarray:
    """Installation errors √v (poses, m) [strain] of gauges on a body from `estimate.tolerances`, to first order:

        vⱼ = Σₖ σₖ² mean_t (sₖⱼ (η − η₀))²,     η = η_pose + ∂η/∂u (u(t) − u_pose)

    averaged over the part of the run nearest to the pose, quasi-static. time (poses,) [s]; zero (r,): η₀ of zeroed gauges, else
    0. Zeros without tolerances."""
    bench, sigma = body.bench, linear_tolerances(body.config)
    v = np.zeros((len(poses), len(gauges)))
    if not sigma:
        return v
    run = np.linspace(0.0, body.config.filter_duration, INSTANTS)
    loads, nearest = loads_of(bench, body.files)(run), np.abs(run[:, None] - time).argmin(axis=1)
    second: list[np.ndarray] = []
    for k, (q, u) in enumerate(poses):
        change = loads[nearest == k] - u if np.any(nearest == k) else np.zeros((1, len(u)))
        change[:, bench.system.drives.at :] = 0.0  # included in the poses
        eta = (q + change @ static_response(bench.system, q, u, bench.theta)[0].T)[:, body.modal] - zero
        second.append(eta.T @ eta / len(eta))
    skin, position = exterior_facets(body.mesh), body.mesh.position
    size = tolerances_of_gauges(body.config).position
    for part in np.array_split(np.arange(len(gauges)), len(gauges) // AT_A_TIME + 1):
        felt = sensitivity_rows(position, gauges.take(part), body.basis, size, facets=skin)
        for name, value in sigma.items():
            s = value * getattr(felt, name)
            v[:, part] += [np.einsum("mi,ij,mj->m", s, C, s, optimize=True) for C in second]
    return np.asarray(np.sqrt(v))
