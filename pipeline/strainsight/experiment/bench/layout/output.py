"""What the placement of a bench writes and prints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.experiment.bench.layout.placement import BenchPlacement
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.mesh.model import Mesh
from strainsight.records.bench_placed import PLACED, BenchCandidates, BenchPlaced
from strainsight.records.record import record_from
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.candidates import UNITS


def output_of(found: BenchPlacement, mesh: Mesh, length_unit: str) -> Output:
    """Datasets, tables and files; gauges.csv has σ without each gauge in N or N m, and as peak the strain at the start.

    mesh of the body that the gauges are on; length_unit of its deck.
    """
    candidates, inputs, symbol = found.on.candidates, found.task.unknowns.names, found.task.criterion.symbol
    record = BenchPlaced(
        **vars(layout_record(found)),
        inputs=inputs,
        units=found.units,
        candidates=record_from(BenchCandidates, candidates, response=found.on.response[0] / found.scale),
        layouts=found.layouts,
    )
    drawn = [layout.std for name, layout in found.layouts.items() if name != PLACED]
    middle = np.median(drawn, axis=0).tolist() if drawn else []
    numbers: dict[str, Scalar] = {"candidates": len(candidates)}
    numbers |= {f"random.{name}": value for name, value in zip(inputs, middle, strict=bool(middle))}
    rows = tuple(
        (name, f"{own.metric:.4g}", *(f"{value:.4g}" for value in own.std)) for name, own in found.layouts.items()
    )
    layouts = Table("layouts", ("layout", symbol, *(f"σ({name})" for name in inputs)), rows)
    tables: tuple[Table, ...] = (layouts,)
    if len(found.time) > 1:
        worst = found.std.max(axis=0)
        listed = zip(found.time, found.std, strict=True)
        rows = tuple((f"{t:.4g} s", *(f"{x:.4g}" for x in own)) for t, own in listed)
        tables += (Table("poses", ("pose", *(f"σ({name})" for name in inputs)), rows),)
        numbers |= {f"best_pose.{name}": float(x) for name, x in zip(inputs, found.std.min(axis=0), strict=True)}
        numbers |= {f"worst_pose.{name}": float(x) for name, x in zip(inputs, worst, strict=True)}
        numbers["poses"] = len(found.time)
    kinds = np.unique(candidates.quantity).tolist()
    output = layout_output(
        found, record, mesh, length_unit, numbers, {}, tables, " or ".join(UNITS[kind] for kind in kinds)
    )
    return replace(output, message=f"{len(candidates)} → {output.message}")
