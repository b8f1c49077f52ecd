"""Config of `kind: placement`: from a mesh to a validated gauge layout."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    DURATION,
    GAUGE_FACTOR,
    PROPERTY,
    RESISTANCE,
    SIZE,
    AxesSection,
    Count,
    DirectionVector,
    Frequency,
    Id,
    Name,
    NamedRun,
    NotNegative,
    Plausible,
    Point,
    Positive,
    Problem,
    Section,
    Text,
    TimeSpan,
    expert,
    with_defaults,
)
from strainsight.config.estimate import Estimate
from strainsight.config.gauges import Gauges, MotionSensors
from strainsight.config.layout import LayoutSettings
from strainsight.config.loads import LoadSection, Settle, TrainingCase
from strainsight.config.mesh import MeshFile
from strainsight.config.tolerances import StatedTolerances, Tolerances, Validate

KeepAll = Literal["all"]


class GuessFrom(Section):
    """A guess that another run has estimated."""

    source: Text = Field(
        alias="from",
        description="Name of the run with the estimate (results/NAME/validate.h5), or path of such a file relative "
        "to the folder of the config.",
    )
    stage: Literal["validate", "estimate"] = expert(
        "validate",
        description="Stage with the estimate: `validate` (simulated measurements), or `estimate` (measurements of a "
        "test, results/NAME/estimate.h5).",
    )


Guess = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[GuessFrom, Tag("from")],
    Discriminator(lambda value: "from" if isinstance(value, dict | GuessFrom) else "number"),
]


class MaterialParameter(Section):
    """A free parameter of the reduced model: a property of some regions, or a factor on the stiffness of springs."""

    property: Literal[
        "youngs_modulus",
        "density",
        "stiffness_factor",
        "e1",
        "e2",
        "g12",
        "g1z",
        "g2z",
        "area_factor",
        "bending_factor",
        "torsion_factor",
        "damping_factor",
        "thickness",
    ] = Field(
        description="Property of the parameter. Materials: youngs_modulus [Pa] and density [kg/m³]; in a laminate, the mean "
        "over the thickness. Regions of any kind, or `springs`: stiffness_factor [-], which scales the whole stiffness. "
        "Plies of laminates: e1 along and e2 across the fibres, shear moduli g12, g1z, g2z, or youngs_modulus of isotropic "
        "plies [Pa]. Beams, relative to the deck [-]: area_factor (with the mass), bending_factor (all second moments of "
        "area), torsion_factor (torsion constant). Rods also have an area_factor, homogeneous shells a bending_factor. "
        "Damping: damping_factor [-], which scales `damping` in every mode, without region. Shells: thickness [m], "
        "including the mass and the surfaces with gauges; all plies of a laminate are scaled by the same factor."
    )
    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="Region id (PSOLID id) or name, or a list of them. Omit it with `springs`, mesh.matrices, a "
        "damping_factor, or with mesh.results, where a parameter applies to all regions.",
    )
    springs: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="Springs that a stiffness_factor scales, instead of a region: names as listed by import (CELAS2 12, "
        "CBUSH 3, SPRINGA 7, mesh.supports.0 of the config), or patterns of names (CELAS2 *).",
    )
    material: Id | Text | None = Field(
        None,
        description="For a ply modulus: id or name of the ply material (MAT8, MAT1), if the regions have several of one kind.",
    )
    guess: Annotated[Guess, PROPERTY] = Field(
        description="Nominal value before any measurement [Pa, kg/m³, m, or 1 for a factor], or {from: another run}."
    )
    range: Annotated[tuple[Positive, Positive], PROPERTY] = Field(
        description="Parameter range [lowest, highest] of the reduced model [Pa, kg/m³, m, or 1 for a factor]."
    )
    process_noise_scale: Annotated[Positive, Plausible(1e-6, 10.0, "1/√s")] = Field(
        0.05,
        description="Drift rate δ of the parameter, relative to its guess [1/√s; 1/s with the thesis rules of "
        "process_noise]. It applies to the steady-state filter for placement, and to filters with filter.drift; otherwise "
        "the parameter is constant.",
    )

    def problems(self) -> Iterator[Problem]:
        low, high = self.range
        if low >= high:
            what = f"the lower limit {low:g} is not below the upper limit {high:g}"
            yield Problem("range", what, "set [lowest, highest]")
        elif isinstance(self.guess, float) and not low <= self.guess <= high:
            what = f"the guess {self.guess:g} is outside the range {low:g} to {high:g}"
            yield Problem("guess", what, "extend the range, or change the guess")


class ModalDamping(Section):
    """Equal damping ratio in every mode."""

    type: Literal["modal"] = Field(description="Kind of damping.")
    ratio: Annotated[float, Plausible(1e-5, 0.2)] = Field(ge=0, lt=1, description="Damping ratio [-].")


class RayleighDamping(Section):
    """C = αM + βK."""

    type: Literal["rayleigh"] = Field(description="Kind of damping.")
    alpha: Annotated[NotNegative, Plausible(1e-6, 1e3, "1/s")] = expert(description="α [1/s].")
    beta: Annotated[NotNegative, Plausible(1e-12, 0.1, "s")] = expert(description="β [s].")


class Damped(Section):
    """Base of sections with structural damping."""

    damping: Annotated[ModalDamping | RayleighDamping, Field(discriminator="type")] = Field(
        description="Structural damping."
    )


class ReducedModelSection(Section):
    """Parametric reduced model."""

    modes: Annotated[int, Plausible(1, 500)] = Field(
        10, ge=1, description="Number of modes for each parameter sample [-]."
    )
    parameter_samples: Count = Field(5, ge=1, description="Number of samples of the parameter range [-].")
    tolerance: Annotated[float, Plausible(1e-14, 0.01)] = Field(
        1e-4,
        gt=0,
        lt=1,
        description="Singular value below which basis vectors from the other samples are truncated, relative to "
        "snapshots of unit energy [-]. This value is approximately the relative strain error at parameters away from "
        "the guess. The run time of `place` is proportional to the cube of the basis size.",
    )


class Train(TimeSpan):
    """Training run."""

    model: Literal["dynamic", "static"] = Field(
        "dynamic",
        description="Model of the motion. With `static`: quasi-static response without inertia, for loads far below the first "
        "natural frequency, in training, placement and filter. The simulated test of `validate` includes inertia. `train` "
        "prints the resulting error.",
    )
    settle: Annotated[Settle, DURATION] = expert(
        "auto",
        description="Start of the motion in training and validation. With `auto`: periodic if every load is a sine "
        "or a multisine, otherwise from rest. With `none`: from rest. A number: from rest, this many seconds before "
        "t = 0, under the same loads.",
    )


class Screen(Section):
    """Selection of the candidates for the elimination."""

    keep: Annotated[Annotated[int, Field(ge=1)] | KeepAll, Plausible(1, 1e6)] = Field(
        "all", description="Number of candidates of each sensor kind to keep [-], or 'all'."
    )
    by: Literal["unknowns", "strength"] = Field(
        "unknowns",
        description="Ranking of the candidates. With `unknowns`: in turn the best for each unknown of `place.estimate` in every "
        "load case, by its effect on the reading relative to noise (and to installation errors with `place.installation: "
        "avoid`). With `strength`: by the training response relative to noise, as in the thesis (5.2).",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Smallest distance between kept candidates [m]. Default with gauges.type: the longer side of its carrier.",
    )


class ProcessNoise(Section):
    """Process noise of the filter."""

    rule: Literal["continuous", "thesis", "as_printed"] = Field(
        "continuous",
        description="Scaling of the process noise of loads. With `continuous`: intensity q = κωa². With `thesis`: "
        "(hωa)² in each step of train.time_step, independent of κ. With `as_printed`: the values of `thesis` and the "
        "variances of the gauges, used as intensities in the Riccati equation.",
    )
    model_error: Annotated[float | None, Plausible(1e-9, 1.0)] = Field(
        None,
        ge=0,
        le=1e6,
        description="Noise on the velocities, relative to the training acceleration [-]. Null: 0.01, since without it the "
        "filter is overconfident if the damping is uncertain. For the grid filter with a damping tolerance the default is "
        "0, since the noise level would carry false information on the parameters.",
    )


class Symmetry(Section):
    """A symmetry plane: gauges on both sides are placed in pairs."""

    point: Point = expert((0.0, 0.0, 0.0), description="A point in the symmetry plane [m].")
    normal: DirectionVector = expert(description="Normal of the symmetry plane in global coordinates [-].")


class PlaceSection(LayoutSettings):
    """Gauge placement by elimination."""

    estimate: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="Unknown loads and parameters to estimate with the layout."
    )
    instants: Count = Field(
        20, ge=1, description="Number of instants of a training run at which the model is linearised [-]."
    )
    parameter_samples: Count = expert(
        1,
        ge=1,
        description="Number of parameter samples for the placement [-]. 1: the guess only; `more`: also samples of the "
        "parameter ranges.",
    )
    load_cases: Annotated[dict[Name, TrainingCase], Field(min_length=1)] | None = Field(
        None,
        description="Load cases, by name, for which one layout is placed together; they replace the signals of "
        "`loads`. Null: one case with the signals of `loads`. Validation always uses `loads`.",
    )
    weights: Literal["normalised", "thesis"] = Field(
        "normalised",
        description="Scaling of the trace criterion. With `normalised`: every unknown has an initial variance of 1. With "
        "`thesis`: the unscaled trace, which depends on the units.",
    )
    damping_slope: bool = Field(
        True,
        description="`true`: the placement includes the change of damping with a parameter. With `false`: the matrices of "
        "the thesis as printed, (5.30) and (5.32), which omit it. The filter always includes it.",
    )
    installation: Literal["avoid", "ignore"] = Field(
        "avoid",
        description="Treatment of installation errors from `tolerances`. With `avoid`: compute one layout for exact gauges "
        "and one with the errors as additional noise, and use the one with the smaller expected σ. With `ignore`: the "
        "layout for exact gauges (thesis).",
    )
    symmetry: Symmetry | None = expert(
        None, description="Symmetry plane for gauges in mirrored pairs; candidates without a mirror image are removed."
    )


class Cases(Section):
    """Observability study of every combination of unknowns (tables 6.1, 6.2): the unknown loads (all loads if all are known), the
    moduli and the densities."""

    frequencies: tuple[Frequency, ...] = Field(
        (),
        description="Frequencies of additional excitations to compare with the training run [Hz]; every load is a sine.",
    )


class Filter(Section):
    """Filter of validation and estimation; place predicts its σ."""

    method: Literal["grid", "extended", "sigma-point"] = Field(
        "grid",
        description="Filter for parameters. With `grid`: multiple-model grid filter; exact for up to three constant "
        "parameters, with normal densities in the additional directions of more parameters. With `extended`: "
        "extended Kalman filter of the thesis, overconfident for weakly observable parameters. With `sigma-point`: "
        "sigma-point filter. The σ of extended and sigma-point excludes tolerances.",
    )
    drift: bool | None = expert(
        None,
        description="`true`: parameters drift with their process_noise_scale in the extended or sigma-point filter. Null: in "
        "the extended filter only, as in the thesis. In the grid filter, parameters are constant.",
    )
    compare: bool | None = Field(
        None,
        description="`true`: compare the grid filter with the other two filters on the same samples, to detect an overconfident "
        "σ. Null: `true` in validate, and in an estimate of up to 20 000 steps (run time about 2 ms for each step).",
    )
    scheme: Literal["exact", "trapezoidal", "implicit_euler"] = expert(
        "exact",
        description="Time integration: exact for every mode, or a scheme with a known bias of frequency and damping, which "
        "is printed.",
    )
    form: Literal["joseph", "square_root"] = expert(
        "joseph",
        description="Covariance form of the extended filter; use square_root if the noise is so small that joseph loses "
        "precision.",
    )
    iterations: int = expert(
        1,
        ge=1,
        le=50,
        description="Relaxation factor of the measurement update of the extended filter [-]; 1 is the Kalman filter. It "
        "affects accelerometers only.",
    )


Export = Literal["nastran", "abaqus", "catman", "labview", "mat"]


class Datum(AxesSection):
    """Datum of the workshop dimensions, in deck coordinates."""


class Report(Section):
    """Results page, and export files for the workshop and other programs."""

    format: Literal["html"] = Field("html", description="Format of the page.")
    remark: str = Field("", max_length=500, description="Remark to print on the page; line breaks are kept.")
    datum: Datum = with_defaults(
        Datum,
        "Datum of gauge positions in the length unit of the deck, for the page, the drawings, workshop.csv and workshop.unv.",
    )
    exports: tuple[Export, ...] = expert(
        (),
        description="Export files. With `nastran`: SET cards of the elements below the gauges, gauges-nastran.inc. "
        "With `abaqus`: *ELSET of the same elements, gauges-abaqus.inp. With `catman` and `labview`: channel tables "
        "for manual setup, channels-catman.txt, channels-labview.txt. With `mat`: linear augmented model with the "
        "strain operator of the layout, model.mat.",
    )
    gauge_factor: Annotated[Positive | None, GAUGE_FACTOR] = expert(
        None, description="Gauge factor in channel tables [-]; null: value of gauges.type, or blank without a type."
    )
    resistance: Annotated[Positive | None, RESISTANCE] = expert(
        None,
        description="Gauge resistance in channel tables [ohm]; null: value of gauges.type, or blank without a type.",
    )


class PlacementConfig(NamedRun, Damped):
    """From a finite-element mesh to a strain-gauge layout with an optimality bound. SI units unless stated otherwise."""

    kind: Literal["placement"] = Field(description="Which pipeline.")
    mesh: MeshFile = Field(description="The finite-element model.")
    parameters: dict[Name, MaterialParameter] = Field({}, description="Free parameters of the model, by name.")
    loads: Annotated[dict[Name, LoadSection], Field(min_length=1)] = Field(description="Loads, by name.")
    solver: Literal["direct", "slepc"] = expert(
        "direct",
        description="Solver of the stiffness matrix, for modes and static responses. With `direct`: PARDISO in this process. "
        "With `slepc`: SLEPc and MUMPS in MPI processes, for models larger than the memory of one machine. STRAINSIGHT_MPI "
        "and STRAINSIGHT_MPI_PYTHON in the environment set the launcher and the number of processes.",
    )
    rom: ReducedModelSection = with_defaults(ReducedModelSection, "Parametric reduced model.")
    train: Train = Field(description="Training run.")
    gauges: Gauges = Field(description="Candidates and their noise.")
    tolerances: StatedTolerances = with_defaults(Tolerances, "Tolerances of installation, loads and model, or none.")
    motion_sensors: dict[Name, MotionSensors] = Field(
        {}, description="Accelerometers and displacement sensors, by name."
    )
    screen: Screen = with_defaults(Screen, "Selection of the candidates for the elimination.")
    process_noise: ProcessNoise = with_defaults(ProcessNoise, "Process noise of the filter.")
    observe: Cases = with_defaults(Cases, "Observability study of the unknowns.")
    place: PlaceSection = Field(description="Gauge placement by elimination.")
    filter: Filter = with_defaults(Filter, "Filter of validation and estimation.")
    validation: Validate = Field(alias="validate", description="Validation of the filter with simulated measurements.")
    estimate: Estimate | None = Field(None, description="Estimation from the measurements of a test.")
    report: Report = with_defaults(Report, "Results page, and export files for the workshop and other programs.")
