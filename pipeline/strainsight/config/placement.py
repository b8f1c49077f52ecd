"""Config of `kind: placement`: from a mesh to a validated gauge layout."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field

from strainsight.config.base import (
    DURATION,
    GAUGE_FACTOR,
    RESISTANCE,
    SIZE,
    AxesSection,
    Count,
    DirectionVector,
    Frequency,
    Name,
    NamedRun,
    NotNegative,
    Plausible,
    Point,
    Positive,
    Section,
    TimeSpan,
    expert,
    with_defaults,
)
from strainsight.config.estimate import Estimate
from strainsight.config.gauges import Gauges, MotionSensors, RelativeNoise
from strainsight.config.layout import LayoutSettings
from strainsight.config.loads import LoadSection, Settle, TrainingCase
from strainsight.config.mesh import MeshFile
from strainsight.config.parameters import DAMPING_TEXT, Damping, MaterialParameter
from strainsight.config.tolerances import StatedTolerances, Studies, Tolerances, Validate


class ReducedModelSection(Section):
    """Reduced model that depends on the parameters."""

    modes: Annotated[int, Plausible(1, 500)] = Field(
        10, ge=1, description="Number of modes computed for each parameter sample [-]."
    )
    parameter_samples: Count = Field(
        5,
        ge=1,
        description="Number of parameter samples in the ranges of the parameters, for which modes are computed [-].",
    )
    tolerance: Annotated[float, Plausible(1e-14, 0.01)] = Field(
        1e-4,
        gt=0,
        lt=1,
        description="Truncation tolerance of the reduced basis [-], for modes and static responses (snapshots) of the "
        "parameter samples other than the guess. Basis vectors with a smaller singular value are omitted; each "
        "snapshot is scaled to unit strain energy. The tolerance is approximately the relative strain error at parameter "
        "values other than the guess. The run time of `place` is proportional to the cube of the basis size.",
    )


class Train(TimeSpan):
    """Training simulation: the simulated response to `loads`. The simulated readings are used to select candidates
    (`screen`) and to place gauges (`place`)."""

    model: Literal["dynamic", "static"] = Field(
        "dynamic",
        description="Model of the motion in the stages `train` and `place` and in the filter. With `dynamic`: with inertia. "
        "With `static`: quasi-static response without inertia, for loads far below the first natural frequency. The "
        "simulated test of `validate` always includes inertia. The stage `train` prints the error of the quasi-static response.",
    )
    settle: Annotated[Settle, DURATION] = expert(
        "auto",
        description="Start of the motion in the stages `train` and `validate`. With `auto`: periodic motion if every load is "
        "a sine or a multisine, otherwise from rest at t = 0. With `none`: from rest at t = 0. With a number: from rest, "
        "this number of seconds before t = 0, under the same loads.",
    )


class Screen(Section):
    """Selection of the candidates for the backward elimination in the stage `place`."""

    keep: Annotated[Annotated[int, Field(ge=1)] | Literal["all"], Plausible(1, 1e6)] = Field(
        "all",
        description="Number of candidates of each sensor kind that are selected for the backward elimination in the stage "
        "`place` [-], or 'all'.",
    )
    by: Literal["unknowns", "strength"] = Field(
        "unknowns",
        description="Ranking of the candidates. With `unknowns`: in every load case, the unknowns of `place.estimate` select "
        "candidates in turn. Each unknown selects the candidate whose reading it changes most, relative to noise (and to "
        "installation errors with `place.installation: avoid`). With `strength`: by the RMS reading in the stage `train` "
        "relative to noise, as in section 5.2 of the thesis of Cottone (2022).",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Smallest distance between selected candidates [m]. Default with gauges.type: the longer side of the "
        "carrier.",
    )


class ProcessNoise(Section):
    """Process noise of the filter."""

    rule: Literal["continuous", "thesis", "as_printed"] = Field(
        "continuous",
        description="Scaling of the process noise of loads with the typical amplitude a and frequency ω. With `continuous`: "
        "intensity q = κωa², with κ = loads.NAME.process_noise.kappa. With `thesis`: variance (hωa)² in each "
        "step h = train.time_step, independent of κ. With `as_printed`: as printed "
        "in the thesis of Cottone (2022), the variances of `thesis` and of the gauges are used as intensities in the Riccati "
        "equation.",
    )
    model_error: Annotated[float | None, Plausible(1e-9, 1.0)] = Field(
        None,
        ge=0,
        le=1e6,
        description="Process noise of the velocities, relative to the RMS acceleration in the training simulation (stage "
        "`train`) [-]. Null: 0.01, since without this noise the filter is overconfident if the damping is uncertain. "
        "Exception: with the grid filter and tolerances.damping above 1, null means 0 in the filter, since this noise "
        "would bias the parameters.",
    )


class Symmetry(Section):
    """A symmetry plane: gauges on both sides are placed in pairs."""

    point: Point = expert((0.0, 0.0, 0.0), description="A point in the symmetry plane [m].")
    normal: DirectionVector = expert(description="Normal of the symmetry plane in global coordinates [-].")


class PlaceSection(LayoutSettings):
    """Gauge placement by backward elimination."""

    estimate: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="Unknown loads and parameters to estimate with the layout."
    )
    instants: Count = Field(
        20,
        ge=1,
        description="Number of instants, in the training simulation of each load case, at which the model is linearised and the "
        "criterion is evaluated [-].",
    )
    parameter_samples: Count = expert(
        1,
        ge=1,
        description="Number of parameter samples for which the criterion is evaluated [-]. 1: the guess only; 2 or more: also "
        "samples of the parameter ranges.",
    )
    load_cases: Annotated[dict[Name, TrainingCase], Field(min_length=1)] | None = Field(
        None,
        description="Load cases, by name, for which one common layout is placed; the load cases replace the signals of `loads`. "
        "Null: one load case with the signals of `loads`. Validation always uses `loads`.",
    )
    weights: Literal["normalised", "thesis"] = Field(
        "normalised",
        description="Scaling of the criterion `trace`. With `normalised`: every unknown has an initial variance of 1. With "
        "`thesis`: the unscaled trace, which depends on the units.",
    )
    damping_slope: bool = Field(
        True,
        description="`true`: the placement includes the change of damping with a parameter. With `false`: the placement uses "
        "equations (5.30) and (5.32) as printed in the thesis of Cottone (2022), without this change. The filter always "
        "includes this change.",
    )
    installation: Literal["avoid", "ignore"] = Field(
        "avoid",
        description="Treatment of installation errors from `tolerances`. With `avoid`: three layouts are computed, one for "
        "exact gauges and two with the errors as additional noise; the layout with the smallest expected σ of the unknowns is "
        "used. With `ignore`: the layout for exact gauges is used, as in the thesis of Cottone (2022).",
    )
    symmetry: Symmetry | None = expert(
        None, description="Symmetry plane for gauges in mirrored pairs; candidates without a mirror image are removed."
    )


class Cases(Section):
    """Observability study of every combination of unknowns, as in tables 6.1 and 6.2 of the thesis of Cottone (2022). The
    unknowns are the unknown loads (all loads if all loads are known), the moduli and the densities."""

    frequencies: tuple[Frequency, ...] = Field(
        (),
        description="Frequencies of additional excitations [Hz]. For each frequency, the observability study is repeated "
        "with every load as a sine of this frequency, for comparison with the signals of `loads`.",
    )


class Filter(Section):
    """Filter of validation and estimation; the stage `place` predicts σ of this filter."""

    method: Literal["grid", "extended", "sigma-point"] = Field(
        "grid",
        description="Filter for parameters. With `grid`: multiple-model grid filter. It is exact for up to three constant "
        "parameters. With more parameters, the grid covers only the most uncertain combination of them; a normal density is "
        "assumed for all other combinations. With `extended`: extended Kalman filter of Cottone (2022), overconfident "
        "for weakly observable parameters. With `sigma-point`: sigma-point filter. The σ of `extended` and `sigma-point` does "
        "not include `tolerances`.",
    )
    drift: bool | None = expert(
        None,
        description="`true`: in the extended or sigma-point filter, parameters drift with their process_noise_scale. Null: "
        "`true` for the extended filter, as in the thesis of Cottone (2022), `false` for the sigma-point filter. In the "
        "grid filter, parameters are constant.",
    )
    compare: bool | None = Field(
        None,
        description="`true`: compare the grid filter with the extended and the sigma-point filter on the same measurements, to "
        "detect an overconfident σ. Null: `true` in `validate`, and in `estimate` for up to 20 000 time steps (run time about 2 "
        "ms for each time step).",
    )
    scheme: Literal["exact", "trapezoidal", "implicit_euler"] = expert(
        "exact",
        description="Time integration. With `exact`: exact for every mode. `trapezoidal` and `implicit_euler` change frequency "
        "and damping of the modes; the change is printed.",
    )
    form: Literal["joseph", "square_root"] = expert(
        "joseph",
        description="Covariance form of the extended filter. Use `square_root` for very small noise, if `joseph` loses "
        "precision.",
    )
    iterations: int = expert(
        1,
        ge=1,
        le=50,
        description="Largest number of iterations of the measurement update of the extended filter [-]; 1: no iteration "
        "(standard extended Kalman filter). Iterations change only the updates with readings of accelerometers.",
    )


class Datum(AxesSection):
    """Datum (coordinate system) of the workshop dimensions, in deck coordinates."""


class Report(Section):
    """Results page, and export files for the workshop and other programs."""

    format: Literal["html"] = Field("html", description="Format of the results page.")
    remark: str = Field(
        "", max_length=500, description="Remark that is printed on the results page; line breaks are kept."
    )
    datum: Datum = with_defaults(
        Datum,
        "Datum of the gauge positions on the results page, in the drawings, in workshop.csv and in workshop.unv; its values "
        "are in the length unit of the deck.",
    )
    exports: tuple[Literal["nastran", "abaqus", "catman", "labview", "mat"], ...] = expert(
        (),
        description="Export files. With `nastran`: SET cards of the elements below the gauges (gauges-nastran.inc). With "
        "`abaqus`: *ELSET of the same elements (gauges-abaqus.inp). With `catman` and `labview`: channel tables for manual "
        "setup (channels-catman.txt, channels-labview.txt). With `mat`: linear augmented model with the strain operator of "
        "the layout (model.mat).",
    )
    gauge_factor: Annotated[Positive | None, GAUGE_FACTOR] = expert(
        None,
        description="Gauge factor in the exported channel tables [-]; null: gauge factor of gauges.type, or blank without "
        "a type.",
    )
    resistance: Annotated[Positive | None, RESISTANCE] = expert(
        None,
        description="Gauge resistance in the exported channel tables [ohm]; null: resistance of gauges.type, or blank without a "
        "type.",
    )


STAGES = (
    *("import", "modes", "rom", "train", "screen", "observe", "place"),
    *("spectrum", "validate", "estimate", "test", "report"),
)
"""Stages of a placement; each needs the sections of those before it."""


def from_stage(
    stage: str, example: str, description: str, absent: Callable[[], object] = lambda: None, alias: str | None = None
) -> Any:
    """A section that is required from a stage on; absent: its value in a config without it."""
    extra: dict[str, Any] = {"required_from": stage, "example": example}
    return Field(default_factory=absent, alias=alias, description=description, json_schema_extra=extra)


ANY_SURFACE = Gauges.model_validate({"noise_std": RelativeNoise(relative_to_strongest=0.01)})
"""Candidates of a config without `gauges`, for the import: the whole surface."""


class PlacementConfig(NamedRun):
    """From a finite-element mesh to a strain-gauge layout with an optimality bound. SI units unless stated otherwise."""

    kind: Literal["placement"] = Field(description="Kind of config: placement of sensors on a structure.")
    mesh: MeshFile = Field(description="The finite-element model.")
    parameters: dict[Name, MaterialParameter] = Field({}, description="Free parameters of the model, by name.")
    loads: Annotated[dict[Name, LoadSection], Field(min_length=1)] = from_stage(
        "rom",
        "{force: {node: 2, direction: [0, 0, 1], known: false, signal: {type: sine, frequency: 1.0, amplitude: 1000.0}}}",
        "Loads, by name.",
        dict,
    )
    damping: Damping = from_stage("rom", "{type: modal, ratio: 0.01}", DAMPING_TEXT)
    solver: Literal["direct", "slepc"] = expert(
        "direct",
        description="Linear solver for the stiffness matrix, for modes and static responses. With `direct`: PARDISO in this "
        "process. With `slepc`: SLEPc and MUMPS in MPI processes, for models larger than the memory of one machine. The "
        "environment variable STRAINSIGHT_MPI sets launcher and number of processes ('mpiexec -n 4'), STRAINSIGHT_MPI_PYTHON the "
        "path of the Python interpreter.",
    )
    rom: ReducedModelSection = with_defaults(ReducedModelSection, "Reduced model that depends on the parameters.")
    train: Train = from_stage(
        "rom",
        "{duration: 20.0, time_step: 0.01, model: static}",
        "Training simulation: the simulated response to `loads`, for the selection of candidates and for `place`.",
    )
    gauges: Gauges = from_stage(
        "train",
        "{direction: {type: principal, angles: [0]}, noise_std: {value: 5.0e-7}}",
        "Candidate gauges, bonded gauges and their noise.",
        lambda: ANY_SURFACE,
    )
    tolerances: StatedTolerances = with_defaults(
        Tolerances, "Tolerances of installation, loads and model; `none` for exact gauges, loads and model."
    )
    motion_sensors: dict[Name, MotionSensors] = Field(
        {}, description="Accelerometers and displacement sensors, by name."
    )
    screen: Screen = with_defaults(
        Screen, "Selection of the candidates for the backward elimination in the stage `place`."
    )
    process_noise: ProcessNoise = with_defaults(ProcessNoise, "Process noise of the filter.")
    observe: Cases = with_defaults(Cases, "Observability study of the unknowns.")
    place: PlaceSection = from_stage(
        "train", "{estimate: [force], keep: 4}", "Gauge placement by backward elimination."
    )
    filter: Filter = with_defaults(Filter, "Filter of validation and estimation.")
    validation: Validate = from_stage(
        "spectrum",
        "{duration: 20.0, time_step: 0.01, initial_std: {force: 1.0}}",
        "Validation of the filter with simulated measurements; without this section, no validation.",
        alias="validate",
    )
    estimate: Estimate | None = Field(None, description="Estimation from the measurements of a test.")
    report: Report = with_defaults(Report, "Results page, and export files for the workshop and other programs.")

    @property
    def lacks_known_load(self) -> bool:
        """Whether parameters and loads are estimated while no load is known: σ then depends on the noise model of the loads."""
        wanted, known = set(self.place.estimate), [load.known for load in self.loads.values()]
        return bool(wanted & set(self.parameters)) and bool(wanted & set(self.loads)) and not any(known)

    @property
    def studies(self) -> Studies:
        """Studies of the stage `validate`; by default a single run where `lacks_known_load` makes σ of all of them invalid."""
        stated = self.validation
        usual = Studies(1, 0, ()) if self.lacks_known_load else Studies(20, 10, (0.1, 5.0))
        return Studies(
            usual.repeats if stated.repeats is None else stated.repeats,
            usual.random_sets if stated.random_sets is None else stated.random_sets,
            usual.noise_factors if stated.noise_factors is None else stated.noise_factors,
        )


def sections_from_stage() -> dict[str, tuple[str, str]]:
    """Section → first stage that needs it, and an example."""
    fields = {field.alias or name: field.json_schema_extra for name, field in PlacementConfig.model_fields.items()}
    extras = {key: extra for key, extra in fields.items() if isinstance(extra, dict) and "required_from" in extra}
    return {key: (str(extra["required_from"]), str(extra["example"])) for key, extra in extras.items()}


NEEDED_BY = {"validate": ("spectrum", "validate")}
"""Sections that only these stages need: without them, the pipeline omits the stages."""


def later_sections(stage: str | None) -> set[str]:
    """Sections that only stages after this one need; none for the whole pipeline (None)."""
    later = STAGES[STAGES.index(stage) + 1 :] if stage in STAGES else ()
    return {key for key, (first, _) in sections_from_stage().items() if first in later}
