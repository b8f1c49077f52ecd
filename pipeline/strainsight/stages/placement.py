"""The placement pipeline: from a deck to a validated layout of gauges.

The stages with their versions and inputs, without their kernels: `status` loads none."""

from __future__ import annotations

from dataclasses import replace

from strainsight.runner.stage import Imported, Stage

LOAD_KINDS = (
    "loads.*.moment",
    "loads.*.bearing",
    "loads.*.pressure",
    "loads.*.factor",
    "loads.*.gravity",
    "loads.*.rotation",
)
"""Keys that determine the kind and unit of a load."""
LOAD_KEYS = ("loads.*.node", "loads.*.set", "loads.*.deck_load", "loads.*.direction", *LOAD_KINDS)
"""Keys read by `point_loads`."""
PARAMETER_KEYS = (
    "parameters.*.property",
    "parameters.*.region",
    "parameters.*.springs",
    "parameters.*.material",
    "parameters.*.range",
)
"""Keys read by `parameters_of`, except the guess."""
SENSOR_KEYS = (
    "gauges.surface",
    "gauges.include",
    "gauges.exclude",
    "gauges.strain_operator",
    "motion_sensors.*.surface",
    "motion_sensors.*.include",
    "motion_sensors.*.exclude",
)
"""Keys of the locations of sensors."""
MODEL_KEYS = ("mesh.length_unit", "mesh.mass_unit", "mesh.matrices", "mesh.free", "mesh.results", "solver")
MODEL_FILES = (
    *("mesh.matrices.numbering", "mesh.matrices.stiffness.*.file", "mesh.matrices.mass.*.file"),
    *("mesh.results.file", "mesh.results.modes.file", "mesh.results.loads.*.file"),
    *("mesh.results.second.file", "mesh.results.second.modes.file", "mesh.results.second.loads.*.file"),
)
"""Keys and files read by stages that call `full_model`."""

IMPORT = Stage(
    "import",
    version=18,
    reads=("mesh", *PARAMETER_KEYS, "parameters.*.guess", *LOAD_KEYS, *SENSOR_KEYS),
    upstream=(),
    files=("mesh.file",),
    run=Imported("strainsight.stages.import_mesh", "run"),
    check=Imported("strainsight.experiment.structure.early", "check_files"),
)

MODES = Stage(
    "modes",
    version=6,
    reads=(*PARAMETER_KEYS, "parameters.*.guess", "rom.modes", *MODEL_KEYS),
    upstream=("import",),
    files=("parameters.*.guess.from", *MODEL_FILES),
    run=Imported("strainsight.stages.rom", "run_modes"),
)

ROM = Stage(
    "rom",
    version=11,
    reads=(
        *PARAMETER_KEYS,
        "parameters.*.guess",
        *LOAD_KEYS,
        "damping",
        "rom",
        "train.model",
        "train.time_step",
        *MODEL_KEYS,
    ),
    upstream=("import", "modes"),
    files=("parameters.*.guess.from", *MODEL_FILES),
    run=Imported("strainsight.stages.rom", "run_rom"),
)

TRAIN = Stage(
    "train",
    version=15,
    reads=(
        "loads.*.signal",
        *LOAD_KINDS,
        "train",
        "place.load_cases",
        *SENSOR_KEYS,
        "gauges.direction",
        "gauges.rosette",
        "gauges.bridge",
        "gauges.grid_length",
        "gauges.fixed",
        "gauges.fixed_file",
        "gauges.snap_tolerance",
        "motion_sensors.*.quantity",
        "motion_sensors.*.axes",
        "motion_sensors.*.every",
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
        "gauges.strain_operator.rows",
        "gauges.strain_operator.table",
        "mesh.matrices.numbering",
    ),
    run=Imported("strainsight.stages.train", "run_train"),
)

SCREEN = Stage(
    "screen",
    version=15,
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
        "loads.*.pressure",
        "loads.*.set",
        "loads.*.deck_load",
        "gauges.allow",
        "gauges.type",
        "gauges.types",
        "gauges.clearance",
        "gauges.exclude",
        "gauges.grid_length",
        "gauges.noise_std",
        "gauges.range",
        "motion_sensors.*.allow",
        "motion_sensors.*.noise_std",
        "motion_sensors.*.range",
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.range",
    ),
    upstream=("import", "rom", "train"),
    files=("loads.*.signal.file", "place.load_cases.*.loads.*.signal.file"),
    run=Imported("strainsight.stages.train", "run_screen"),
)

OBSERVE = Stage(
    "observe",
    version=2,
    reads=("seed", "loads", "parameters.*.property", "train", "observe", "place.instants"),
    upstream=("rom", "train", "screen"),
    files=("loads.*.signal.file",),
    run=Imported("strainsight.stages.train", "run_observe"),
)

PLACE = Stage(
    "place",
    version=40,
    reads=(
        "seed",
        "mesh.length_unit",
        "mesh.point_masses",
        "loads.*.node",
        "loads.*.set",
        "loads.*.deck_load",
        *LOAD_KINDS,
        "loads.*.signal",
        "loads.*.process_noise",
        "parameters.*.process_noise_scale",
        *PARAMETER_KEYS,
        "process_noise",
        "tolerances",
        "train",
        "place",
        "filter.method",
        "filter.drift",
        "filter.scheme",
        "filter.form",
        "filter.iterations",
        "gauges.price",
        "motion_sensors.*.price",
    ),
    upstream=("import", "rom", "train", "screen"),
    files=("loads.*.signal.file", "place.load_cases.*.loads.*.signal.file"),
    run=Imported("strainsight.stages.place", "run"),
    records=("gauges.csv",),
)

ESTIMATE = Stage(
    "estimate",
    version=49,
    reads=(
        "seed",
        "mesh.point_masses",
        "loads",
        "parameters",
        "process_noise",
        "train",
        "tolerances",
        "place.estimate",
        "place.instants",
        "validate.initial_std",
        "estimate",
        "filter",
        "gauges.grid_length",
        "gauges.snap_tolerance",
        *MODEL_KEYS,
    ),
    upstream=("import", "rom", "train", "screen", "place"),
    files=(
        "loads.*.signal.file",
        "estimate.file",
        "estimate.records.*.file",
        "estimate.gauges_file",
        "parameters.*.guess.from",
        *MODEL_FILES,
    ),
    run=Imported("strainsight.stages.estimate", "run"),
)

TEST = Stage(
    "test",
    version=11,
    reads=("name", "seed", "loads", "place.estimate", "estimate.virtual"),
    upstream=("import", "rom", "train", "screen", "place", "estimate"),
    files=(),
    run=Imported("strainsight.stages.measurement_report", "run"),
)

SPECTRUM = Stage(
    "spectrum",
    version=6,
    reads=(*PARAMETER_KEYS, "validate.truth.modes", *MODEL_KEYS),
    upstream=("import",),
    files=MODEL_FILES,
    run=Imported("strainsight.stages.rom", "run_spectrum"),
)

VALIDATE = Stage(
    "validate",
    version=39,
    reads=(
        "damping",
        *(
            "seed",
            "mesh.point_masses",
            "parameters",
            "loads",
            "process_noise",
            "train",
            "tolerances",
            "place.estimate",
            "filter",
            "validate",
        ),
        *MODEL_KEYS,
    ),
    upstream=("import", "rom", "train", "screen", "place", "spectrum"),
    files=("parameters.*.guess.from", "loads.*.signal.file", *MODEL_FILES),
    run=Imported("strainsight.stages.validate", "run"),
)

REPORT = Stage(
    "report",
    version=30,
    reads=(
        "name",
        "seed",
        "loads",
        "parameters.*.property",
        "tolerances",
        "place.estimate",
        "validate.truth.model",
        "mesh.file",
        "mesh.length_unit",
        "mesh.free",
        "gauges.type",
        "gauges.types",
        "report",
    ),
    upstream=("import", "rom", "train", "screen", "observe", "place", "validate"),
    files=(),
    run=Imported("strainsight.stages.report", "run"),
)

PLACEMENT = (IMPORT, MODES, ROM, TRAIN, SCREEN, OBSERVE, PLACE, SPECTRUM, VALIDATE, REPORT)


def stages_for(estimates: bool, truth: str | None) -> tuple[Stage, ...]:
    """The pipeline. estimates: whether the config names a test; truth: `validate.truth.model`, None without validation."""
    omitted = [SPECTRUM.name] * (truth not in ("modes", "perturbed")) + [VALIDATE.name] * (truth is None)
    stages = list(PLACEMENT)
    if estimates:
        stages[-1] = replace(REPORT, upstream=(*REPORT.upstream, ESTIMATE.name))
        stages[PLACEMENT.index(PLACE) + 1 : PLACEMENT.index(PLACE) + 1] = ESTIMATE, TEST

    def linked(stage: Stage) -> Stage:
        # of an absent section, nothing but its absence can be read
        reads = ["validate" if truth is None and key.startswith("validate.") else key for key in stage.reads]
        upstream = tuple(name for name in stage.upstream if name not in omitted)
        return replace(stage, reads=tuple(dict.fromkeys(reads)), upstream=upstream)

    return tuple(linked(stage) for stage in stages if stage.name not in omitted)
