"""train: the reduced model under its loads, and what every candidate on the surface reads of it (5.2)."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.candidates import OnSurface, training_units
from strainsight.experiment.structure.expectation import unresolved_candidates
from strainsight.experiment.structure.reduction import inertia_problems
from strainsight.experiment.structure.references import KINDS_OF_LOAD, load_units
from strainsight.experiment.structure.training import trained
from strainsight.measurements.calibration import LARGE_STRAIN
from strainsight.records.record import written
from strainsight.runner.output import Output, Table
from strainsight.runner.stage import Context, Stage
from strainsight.sensors.candidates import Candidates
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The training run, and where bonded gauges were moved to."""
    reduced = inputs.reduced(context)
    result = trained(context.config, inputs.mesh(context), reduced, context)
    training, surface = result.training, result.surface
    pool, moved = training.candidates, training.moved
    rms = training.rms
    if warning := unresolved_candidates(training):
        warnings.warn(warning, stacklevel=2)
    for warning in inertia_problems(context.config.train, training, float(reduced.frequency[0])):
        warnings.warn(warning, stacklevel=2)
    strongest = float(rms[pool.quantity == pool.quantity[0]].max())
    steps = len(training.time) - 1
    return Output(
        datasets=written(training, training_units(pool.quantity) | {"the loads": load_units(context.config.loads)}),
        summary={
            "candidates": pool.gauges,
            "left_out": surface.left_out if surface else 0,
            "channels": len(training.rows),
            "steps": steps,
            "strongest_rms": strongest,
        },
        message=_message(pool, steps, strongest, surface, sorted(training.cases)),
        tables=() if moved is None else (_bonded_table(pool, training.name, moved),),
    )


def _message(pool: Candidates, steps: int, strongest: float, surface: OnSurface | None, cases: Sequence[str]) -> str:
    first = pool.first
    kinds = (
        (pool.array[first] == 0) & ~pool.bonded[first],
        pool.bonded[first],
        pool.quantity[first] == 1,
        pool.quantity[first] == 2,
    )
    words = ("candidates", "bonded", "accelerometers", "displacement sensors")
    counts = ", ".join(f"{kind.sum()} {word}" for kind, word in zip(kinds, words, strict=True) if kind.any())
    parts = [counts, f"{steps} steps, strongest RMS {1e6 * strongest:.4g} µm/m"]
    if cases:
        parts[1] += f" of {len(cases)} load case{'s' * (len(cases) > 1)}: {', '.join(cases)}"
    if strongest > LARGE_STRAIN:
        parts.append("far from small: are load and modulus in the right unit?")
    if surface is not None and len(surface.moved):
        parts.append(f"bonded ones moved by up to {1e3 * surface.moved.max():.2g} mm")
    if surface is not None and surface.left_out:
        parts.append(f"{surface.left_out} places left out: a grid over a sharp edge")
    if surface is not None and surface.alone:
        parts.append(f"{surface.alone} places left out: no facet opposite that takes the arms of a bridge")
    if surface is not None and surface.twice:
        parts.append(f"{surface.twice} bridges taken once of two that are one, seen from its sides")
    if surface is not None and surface.empty:
        parts.append(f"no facet in the zone {', '.join(surface.empty)}: is it in metres?")
    return ", ".join(parts)


def _spaced(words: Iterable[str]) -> str:
    return " ".join(words)


def _bonded_table(pool: Candidates, names: Sequence[str], moved: np.ndarray) -> Table:
    """Where the bonded gauges are, of bridges all arms; they are the first candidates."""
    rows = tuple(
        (
            names[i] or f"fixed {i + 1}",
            "/".join(str(element) for element in grids.element),
            "/".join(str(facet) for facet in grids.facet),
            ", ".join(_spaced(f"{x:.4f}" for x in position) for position in grids.position),
            ", ".join(_spaced(f"{round(d, 3) + 0.0:g}" for d in direction) for direction in grids.direction),
            f"{1e3 * moved[i]:.3g} mm",
        )
        for i, c in enumerate(pool.first[: len(moved)])
        for grids in (pool.take(np.array([c])).grids,)
    )
    return Table(
        "bonded gauges, moved to the surface", ("gauge", "element", "facet", "x y z [m]", "direction", "moved by"), rows
    )


TRAIN = Stage(
    "train",
    version=14,
    reads=(
        "loads.*.signal",
        *KINDS_OF_LOAD,
        "train",
        "place.load_cases",
        "gauges.surface",
        "gauges.direction",
        "gauges.rosette",
        "gauges.bridge",
        "gauges.grid_length",
        "gauges.include",
        "gauges.exclude",
        "gauges.fixed",
        "gauges.fixed_file",
        "gauges.snap_tolerance",
        "gauges.given",
        "motion_sensors.*.quantity",
        "motion_sensors.*.surface",
        "motion_sensors.*.axes",
        "motion_sensors.*.every",
        "motion_sensors.*.include",
        "motion_sensors.*.exclude",
        "mesh.length_unit",
        "mesh.matrices",
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.range",
    ),
    upstream=("import", "rom"),
    files=(
        "loads.*.signal.file",
        "place.load_cases.*.loads.*.signal.file",
        "gauges.fixed_file",
        "gauges.given.rows",
        "gauges.given.table",
        "mesh.matrices.numbering",
    ),
    run=run,
)
