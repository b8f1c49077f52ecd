"""The bench of a config through the stages `import` and `reduce`, for what is measured on it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.load import load_config
from strainsight.experiment.bench.bench import Bench, bench_of
from strainsight.experiment.bench.sensors import sensors_of
from strainsight.multibody.forces import RelativeElement
from strainsight.multibody.initial import project_position, state, static_equilibrium
from strainsight.multibody.sensors import CompiledSensors, RelationSensor, readings
from strainsight.records.bench import ReducedBodies
from strainsight.records.mesh import Meshes
from strainsight.records.record import read
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages.bench.import_bodies import IMPORT, REDUCE

CONFIG = Path(__file__).parents[1] / "configs" / "bench-full.yaml"


@dataclass(frozen=True)
class FullBench:
    """The bench of a config; sensors: its gauges, then the five displacements of its bearing."""

    config: BenchConfig
    bench: Bench
    sensors: CompiledSensors
    bearing: RelativeElement

    def at_rest(self, u: np.ndarray) -> np.ndarray:
        """q (n,) in equilibrium under the loads u (nu,)."""
        system, theta = self.bench.system, self.bench.theta
        return static_equilibrium(system, project_position(system, state(system, self.bench.poses)[0]), u, theta)[0]


def full_bench(path: Path = CONFIG, free: Mapping[str, Sequence[str]] | None = None) -> FullBench:
    """free: bearing → its properties that are parameters of the system."""
    loaded = load_config(path)
    assert isinstance(loaded.model, BenchConfig)
    with tempfile.TemporaryDirectory() as folder:
        job = Job(loaded.data, path.parent, Path(folder), model=loaded.model)
        made = {event.stage: event.artefact for event in run((IMPORT, REDUCE), job) if event.artefact is not None}
        meshes, reduced = read(Meshes, made["import"]).bodies, read(ReducedBodies, made["reduce"]).bodies
        bench = bench_of(loaded.model, reduced, meshes, free=free)
        every = sensors_of(bench).readings.sensors
    bearing = bench.system.elements[0].force
    assert isinstance(bearing, RelativeElement)
    gauges = [own for own in every if own.name == "gauges"]
    sensors = readings(bench.system, [*gauges, RelationSensor("relative", bearing.relations)])
    return FullBench(loaded.model, bench, sensors, bearing)


def loads_of_file(names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Instants (T,) [s] and loads (T, nu) of the file beside the config."""
    table = np.genfromtxt(CONFIG.parent / "bench-load.csv", delimiter=",", names=True)
    return table["time"], np.column_stack([table[name] for name in names])
