"""estimate: loads and parameters of a bench from its sensors, by Kalman filters on the implicit step (thesis 2-4)."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import ArtefactError
from strainsight.experiment.bench.inverse.consistency import estimate_output
from strainsight.experiment.bench.inverse.estimation import estimate_bench
from strainsight.experiment.bench.inverse.problem import free_properties
from strainsight.records.bench import BenchTruths, Simulated
from strainsight.records.record import read
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES


def run(context: Context[BenchConfig]) -> Output:
    """Simulate or fetch the measurements, run the filter on them, compare."""
    config, up = context.config, context.upstream
    bench = inputs.bench(context, free_properties(config.estimator))
    truths = read(BenchTruths, up["truth"]) if "truth" in up else None
    return estimate_output(config, estimate_bench(bench, _other_bench(context), truths, context))


def _other_bench(context: Context[object]) -> Simulated | None:
    """The run of `estimate.measured`."""
    key = "estimate.measured.from"
    if key not in context.files:
        return None
    artefact = Artefact(context.files[key])
    if artefact.header.stage != "simulate":
        raise ArtefactError(
            f"{artefact.path.name} is the results file of the stage '{artefact.header.stage}', not of the stage 'simulate'",
            key=key,
            remedy="set the key to the name of a bench run, or to the file simulate.h5 of a run",
        )
    return read(Simulated, artefact)


ESTIMATE = Stage(
    "estimate",
    version=19,
    reads=("seed", "bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate", "estimate"),
    upstream=("import", "reduce"),
    files=(*HISTORIES, "estimate.measured.from", "estimate.measured.file"),
    run=run,
)
