"""truth: simulation of the bench with another integrator, for the measurements of every run with these loads."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.inverse.truth import truths_of
from strainsight.experiment.bench.loads import load_units
from strainsight.records.record import written
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES


def run(context: Context[BenchConfig]) -> Output:
    """One history or several, without noise, which is the estimate's."""
    config = context.config
    truth = config.estimator.truth
    truths = truths_of(inputs.bench(context), truth, truth.duration or config.filter_duration, context)
    steps, histories = len(truths.time) - 1, len(truths.begin)
    text = f"{histories} simulated time histor{'y' if histories == 1 else 'ies'} of {steps} steps of {truth.step:g} s (Radau)"
    return Output(
        datasets=written(truths, {f"input {name}": unit for name, unit in load_units(config, truths.inputs).items()}),
        summary={"histories": histories, "steps": steps},
        message=text,
    )


def truth_stage(duration: bool) -> Stage:
    """duration: whether the simulation has a separate duration, so that runs with different estimates share it."""
    keys = tuple(f"estimate.truth.{key}" for key in ("step", "histories", "within", "duration"))
    lengths = () if duration else ("estimate.duration", "simulate.duration")
    return Stage(
        "truth",
        version=2,
        reads=("seed", "bodies", "frames", "joints", "bearings", "forces", *keys, *lengths, *STARTS),
        upstream=("import", "reduce"),
        files=HISTORIES,
        run=run,
    )


STARTS = tuple(f"simulate.{key}" for key in ("start", "snap_tolerance", "allow_unstable"))
"""Keys of the simulation that define the initial state."""
