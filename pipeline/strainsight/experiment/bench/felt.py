"""What joints and drives carry in a run of a bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor
from strainsight.experiment.bench.bench import Bench
from strainsight.multibody.accelerations import Instant, reaction
from strainsight.multibody.simulate import Trajectory
from strainsight.records.simulated import DriveMotion

Reading = Callable[[np.ndarray, np.ndarray, Instant], np.ndarray]
"""q, u and what (1.3) says there → the components of a sensor."""


def felt(
    config: BenchConfig, bench: Bench, found: Trajectory, instants: Sequence[Instant], drives: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, DriveMotion]]:
    """Sensors of reaction (T, components), and the driven joints, drives (nd, 3, T) p, ṗ, p̈."""
    read: dict[str, np.ndarray] = {}
    for name, entry in config.sensors.items():
        if isinstance(entry, ReactionSensor):
            own = _reaction(config, bench, entry)
            read[name] = np.array([own(*now) for now in zip(found.q, found.u, instants, strict=True)])
    force = np.array([now.drive for now in instants])
    return read, {
        name: DriveMotion(position=drives[i, 0], rate=drives[i, 1], force=force[:, i])
        for i, name in enumerate(bench.system.drives.names)
    }


def feels(config: BenchConfig, bench: Bench) -> bool:
    """Whether anything of the config asks for what (1.3) says of every instant."""
    asking = (isinstance(own, ReactionSensor | AccelerationSensor) for own in config.sensors.values())
    return any(asking) or bool(bench.system.drives.names)


def _reaction(config: BenchConfig, bench: Bench, entry: ReactionSensor) -> Reading:
    joint = next(own for own in bench.system.joints if own.name == entry.joint)
    i, j = (bench.frames[frame] for frame in config.joints[entry.joint].frames)
    return lambda q, u, now: reaction(bench.system, joint, i, j, q, now.lam, u)
