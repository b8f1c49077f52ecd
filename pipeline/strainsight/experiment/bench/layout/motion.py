"""Displacement sensors and accelerometers of a bench among the candidates of its placement, each component one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, MotionSensor, RelativeSensor
from strainsight.config.bench.place import BenchPlace
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.sensors import motion_sensor
from strainsight.multibody.accelerations import at_rest, measured
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.multibody.sensors import axis_sensor, position_sensor, readings
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, Candidates

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
