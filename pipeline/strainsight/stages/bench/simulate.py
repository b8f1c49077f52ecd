"""simulate: the bench in time, by two implicit stages a step or the thesis's stabilised implicit Euler (1.5-1.7)."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.simulation import simulate_output
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES


def run(context: Context[BenchConfig]) -> Output:
    """The bench in time, with what the stages above have made of its bodies."""
    return simulate_output(inputs.bench(context), context)


SIMULATE = Stage(
    "simulate",
    version=6,
    reads=("bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate"),
    upstream=("import", "reduce"),
    files=HISTORIES,
    run=run,
)
