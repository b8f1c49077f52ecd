"""What the stages of a bench read from the artefacts above them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.bench import Bench, bench_of
from strainsight.mesh.model import Mesh
from strainsight.records.bench import ReducedBodies, ReducedBody
from strainsight.records.bench_placed import BenchPlaced
from strainsight.records.mesh import Meshes
from strainsight.records.record import read
from strainsight.runner.stage import Context

HISTORIES = ("forces.*.signal.file", "forces.*.turns.signal.file", "joints.*.drive.signal.file")
"""Keys of files with loads, turns of gravity and drives."""


def meshes(context: Context[object]) -> dict[str, Mesh]:
    """import.h5: flexible body → its mesh."""
    return read(Meshes, context.upstream["import"]).bodies


def bodies(context: Context[object]) -> dict[str, ReducedBody]:
    """reduce.h5: flexible body → what it was reduced to."""
    return read(ReducedBodies, context.upstream["reduce"]).bodies


def bench(context: Context[BenchConfig], free: Mapping[str, Sequence[str]] | None = None) -> Bench:
    """The bench with what the stages above have made of its bodies, and place.h5 where a sensor takes a layout of it; free:
    bearing → its properties that are parameters."""
    up = context.upstream
    placed = read(BenchPlaced, up["place"]) if "place" in up else None
    return bench_of(context.config, bodies(context), meshes(context), placed, free)
