"""screen: the candidates with the best signal to noise, thinned where they crowd (5.2)."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator

import numpy as np

from strainsight.config.placement import PlacementConfig, Screen
from strainsight.experiment.structure.candidates import training_units
from strainsight.experiment.structure.clearance import (
    bent_gauges,
    bent_warning,
    clearance_in_words,
    clearance_warning,
    type_in_words,
    type_table,
)
from strainsight.experiment.structure.expectation import loud_noise, quiet_noise
from strainsight.experiment.structure.screening import screened_of
from strainsight.records.record import written
from strainsight.records.training import Screened
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.screening import BEND, BEYOND, CLEARANCE, NEAR
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """Which candidates go on, and why the others do not."""
    config, mesh, training = context.config, inputs.mesh(context), inputs.training(context)
    screened, pool = screened_of(config, context.files, mesh, inputs.reduced(context), training), training.candidates
    dropped = Counter(str(code) for code in screened.reason if code)
    noise, strain = float(screened.noise_std[0]), pool.quantity[0] == 0
    shown = f"{1e6 * noise:.3g} µm/m" if strain else f"{noise:.3g}"
    parts = [f"{pool.gauges} → {len(screened.kept)}", f"noise {shown}"]
    for warning in _fewer_than_asked(context.config.screen, screened, pool):
        warnings.warn(warning, stacklevel=2)
    clearance, numbers = screened.clearance, {}
    if clearance is not None:
        parts.append(clearance_in_words(clearance, dropped[CLEARANCE]))
        numbers = {"clearance": clearance.distance}
        if warning := clearance_warning(clearance):
            warnings.warn(warning, stacklevel=2)
    if dropped[BEND]:
        parts.append(f"{dropped[BEND]} where the surface bends too tightly")
    bent = bent_gauges(config, mesh, training)
    if warning := bent_warning(config, training, bent):
        warnings.warn(warning, stacklevel=2)
        parts.append(f"{int((bent & pool.bonded[pool.first]).sum())} bonded where the surface bends too tightly")
    for warning in filter(None, (quiet_noise(training, screened), loud_noise(training, screened))):
        warnings.warn(warning, stacklevel=2)
    if kind := type_in_words(config):
        parts.append(kind)
    return Output(
        datasets=written(screened, training_units(pool.quantity)),
        summary={"candidates": pool.gauges, "kept": len(screened.kept), "noise_std": noise}
        | {f"dropped.{code}": count for code, count in dropped.items()}
        | numbers,
        message=", ".join(parts),
        tables=type_table(config),
    )


def _fewer_than_asked(settings: Screen, found: Screened, pool: Candidates) -> Iterator[str]:
    """Of every kind of sensor of which spacing and range leave fewer than `screen.keep`."""
    kind = pool.array[pool.first]
    for i in np.unique(kind):
        own = found.reason[kind == i]
        clear = int(np.count_nonzero(~np.isin(own, (CLEARANCE, BEND))))
        kept = int(np.count_nonzero(kind[found.kept] == i))
        if settings.keep != "all" and kept < min(settings.keep, clear):
            name = str(found.family[int(i)])
            spacing = f"{1e3 * settings.minimum_spacing:g} mm apart", "lower screen.minimum_spacing"
            beyond = "within their range", "choose sensors of a larger one"
            said, remedy = zip(
                *[words for code, words in ((NEAR, spacing), (BEYOND, beyond)) if code in own], strict=True
            )
            yield (
                f"screen.keep asks for {settings.keep} candidates of {name}: of {clear} only {kept} are {' and '.join(said)}. "
                f"{' or '.join(remedy).capitalize()}, for a larger choice."
            )


SCREEN = Stage(
    "screen",
    version=13,
    reads=(
        "screen",
        "train",
        "tolerances",
        "process_noise.rule",
        "place.installation",
        "place.load_cases",
        "place.estimate",
        "loads.*.signal",
        "loads.*.node",
        "loads.*.moment",
        "loads.*.set",
        "loads.*.deck_load",
        "gauges.type",
        "gauges.types",
        "gauges.clearance",
        "gauges.exclude",
        "gauges.grid_length",
        "gauges.noise_std",
        "gauges.range",
        "motion_sensors.*.noise_std",
        "motion_sensors.*.range",
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.range",
    ),
    upstream=("import", "rom", "train"),
    files=("loads.*.signal.file", "place.load_cases.*.loads.*.signal.file"),
    run=run,
)
