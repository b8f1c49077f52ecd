"""reduce: every flexible body to the motions of its interface nodes and a few modes (thesis 1.8-1.17)."""

from __future__ import annotations

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.reduction import BodyReduction, reductions
from strainsight.records.bench import ReducedBodies
from strainsight.records.record import written
from strainsight.runner.output import Output, Scalar, Table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs


def run(context: Context[BenchConfig]) -> Output:
    """The reduced bodies, and their natural frequencies for a look."""
    found = reductions(context.config, inputs.meshes(context), context)
    summary: dict[str, Scalar] = {}
    text = []
    for name, own in found.items():
        first, size = float(own.frequency[0]), len(own.body.mass)
        summary |= {f"unknowns.{name}": own.unknowns, f"coordinates.{name}": size, f"first_frequency.{name}": first}
        text.append(f"{name} {own.unknowns} unknowns → {size}, first mode {first:.4g} Hz, cut {own.body.cut:.4g} Hz")
        text += [
            f"{name} is good for {key} from {low:.4g} to {high:.4g} Pa"
            for key, (low, high) in own.body.reach.items()
            if np.isfinite(high)
        ]
    return Output(
        datasets=written(ReducedBodies(bodies={name: own.body for name, own in found.items()})),
        summary=summary,
        message="; ".join(text) or "no flexible body",
        tables=tuple(_table(name, own) for name, own in found.items()),
    )


def _table(name: str, own: BodyReduction) -> Table:
    rows = tuple((str(k), f"{f:.4g}") for k, f in enumerate(own.frequency[:12], start=1))
    return Table(f"natural frequencies of {name}, its interfaces free", ("mode", "Hz"), rows)


REDUCE = Stage(
    "reduce",
    version=8,
    reads=(
        "bodies.*.type",
        "bodies.*.modes",
        "bodies.*.cutoff",
        "bodies.*.damping",
        "bodies.*.moduli",
        "frames.*.body",
        "frames.*.node",
    ),
    upstream=("import",),
    files=(),
    run=run,
)
