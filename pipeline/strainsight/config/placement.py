"""The config of `kind: placement`: from a deck to a validated gauge layout."""

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
    """A guess that another run estimated."""

    source: Text = Field(
        alias="from",
        description="Name of the run (results/NAME/validate.h5), or the path of such a file from the config's folder.",
    )
    stage: Literal["validate", "estimate"] = expert(
        "validate",
        description="Which estimates of the run named so: of simulated measurements, or of a test (results/NAME/estimate.h5).",
    )


Guess = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[GuessFrom, Tag("from")],
    Discriminator(lambda value: "from" if isinstance(value, dict | GuessFrom) else "number"),
]


class MaterialParameter(Section):
    """A property of some regions, or a factor of some springs, that the reduced model keeps free."""

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
        description="Which property: youngs_modulus [Pa], density [kg/m³], of a laminate the mean over its thickness, or "
        "stiffness_factor [-], which multiplies all stiffness of the regions as the deck has it, whatever they are made of: "
        "laminates, several materials, beams whose section is uncertain; or the stiffness of `springs`. Of plies of laminates: "
        "e1 and e2 along and across their fibres, g12, g1z and g2z of shear across, or youngs_modulus of isotropic plies [Pa]. "
        "Of beams, as factors of what the deck has [-]: area_factor, with the mass, bending_factor of all second moments, "
        "torsion_factor of the torsion constant; an area_factor of rods, too, and a bending_factor of homogeneous shells. "
        "damping_factor [-], without region, multiplies `damping` in every mode. "
        "Of shells: thickness [m], with the mass and the faces where gauges sit; that of a laminate scales all its plies alike."
    )
    region: Id | Text | Annotated[tuple[Id | Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="Region id (PSOLID id) or name, or a list of them; left out only with `springs`, mesh.matrices or a "
        "damping_factor, or with mesh.results, which know all regions alone.",
    )
    springs: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        None,
        description="In place of region, of a stiffness_factor: springs by the names that import lists (CELAS2 12, CBUSH 3, "
        "SPRINGA 7, of the config mesh.supports.0) or by patterns of names (CELAS2 *), as of a foundation.",
    )
    material: Id | Text | None = Field(
        None,
        description="Of a modulus of plies: id or name of their material (MAT8, MAT1), where they have several of one kind.",
    )
    guess: Annotated[Guess, PROPERTY] = Field(
        description="Value before anything is measured [Pa, kg/m³, m, or 1 for a factor], or {from: another run}."
    )
    range: Annotated[tuple[Positive, Positive], PROPERTY] = Field(
        description="[lowest, highest] value the reduced model is made for [Pa, kg/m³, m, or 1 for a factor]."
    )
    process_noise_scale: Annotated[Positive, Plausible(1e-6, 10.0, "1/√s")] = Field(
        0.05,
        description="δ: how fast the parameter may drift, relative to its guess [1/√s; 1/s under the thesis's rules of "
        "process_noise], in the steady filter that ranks layouts and where filter.drift lets it; else it is a constant.",
    )

    def problems(self) -> Iterator[Problem]:
        low, high = self.range
        if low >= high:
            what = f"the lowest value {low:g} is not below the highest {high:g}"
            yield Problem("range", what, "give [lowest, highest]")
        elif isinstance(self.guess, float) and not low <= self.guess <= high:
            what = f"{self.guess:g} lies outside the range {low:g} to {high:g}"
            yield Problem("guess", what, "widen the range of the parameter, or guess within it")


class ModalDamping(Section):
    """The same damping ratio in every mode."""

    type: Literal["modal"] = Field(description="Kind of damping.")
    ratio: Annotated[float, Plausible(1e-5, 0.2)] = Field(ge=0, lt=1, description="Damping ratio [-].")


class RayleighDamping(Section):
    """C = αM + βK."""

    type: Literal["rayleigh"] = Field(description="Kind of damping.")
    alpha: Annotated[NotNegative, Plausible(1e-6, 1e3, "1/s")] = expert(description="α [1/s].")
    beta: Annotated[NotNegative, Plausible(1e-12, 0.1, "s")] = expert(description="β [s].")


class Damped(Section):
    """What has structural damping."""

    damping: Annotated[ModalDamping | RayleighDamping, Field(discriminator="type")] = Field(
        description="Structural damping."
    )


class ReducedModelSection(Section):
    """The parametric reduced model."""

    modes: Annotated[int, Plausible(1, 500)] = Field(10, ge=1, description="Modes per parameter sample [-].")
    parameter_samples: Count = Field(5, ge=1, description="Samples of the parameter box [-].")
    tolerance: Annotated[float, Plausible(1e-14, 0.01)] = Field(
        1e-4,
        gt=0,
        lt=1,
        description="Singular value, beside snapshots of unit energy, below which shapes of the other samples are cut [-]: about "
        "the relative error in strain at a parameter off the guess. `place` takes as long as the cube of what is kept.",
    )


class Train(TimeSpan):
    """The training run."""

    model: Literal["dynamic", "static"] = Field(
        "dynamic",
        description="static: for loads far below the first mode, the structure follows them without inertia, in training, "
        "placement and filter; the truth of `validate` keeps its inertia. `train` says how much that leaves out.",
    )
    settle: Annotated[Settle, DURATION] = expert(
        "auto",
        description="How the motion of training and validation begins. auto: periodic where every load is a sine or a "
        "multisine, else from rest; none: from rest; a number: from rest so long before t = 0, under the same loads [s].",
    )


class Screen(Section):
    """Which candidates enter the elimination."""

    keep: Annotated[Annotated[int, Field(ge=1)] | KeepAll, Plausible(1, 1e6)] = Field(
        "all", description="Candidates to keep of every kind of sensor [-] at most, or 'all'."
    )
    by: Literal["unknowns", "strength"] = Field(
        "unknowns",
        description="Which come first. unknowns: in turn the best for each unknown of `place.estimate` in every load case, by "
        "what that unknown alone makes them read, over their noise and, where `place.installation` avoids them, over their noise "
        "and errors of installation; strength: those that read most in training over their noise, as the thesis has it (5.2).",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0, description="Least distance between kept candidates [m]. With gauges.type: the longer side of its carrier."
    )


class ProcessNoise(Section):
    """Process noise of the filter."""

    rule: Literal["continuous", "thesis", "as_printed"] = Field(
        "continuous",
        description="continuous: intensities q = κωa²; thesis: (hωa)² a step of train.time_step, whatever κ is; as_printed: "
        "those numbers, and σ² of the gauges, put into the Riccati equation as if they were intensities.",
    )
    model_error: Annotated[float | None, Plausible(1e-9, 1.0)] = Field(
        None,
        ge=0,
        le=1e6,
        description="Noise on the velocities as a share of the training acceleration [-]; null: 0.01, without which a "
        "filter is overconfident where the damping is not exact; but 0 in a bank over parameters for which the damping has a "
        "tolerance: the size of a noise that is not there would tell it of the parameters.",
    )


class Symmetry(Section):
    """A plane: gauges on both sides are placed in pairs."""

    point: Point = expert((0.0, 0.0, 0.0), description="A point of the plane [m].")
    normal: DirectionVector = expert(description="Its normal in global coordinates [-].")


class PlaceSection(LayoutSettings):
    """The elimination."""

    estimate: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="Unknown loads and parameters to place for."
    )
    instants: Count = Field(20, ge=1, description="Instants of a training run that the model is linearised at [-].")
    parameter_samples: Count = expert(
        1,
        ge=1,
        description="Parameter values to place for [-]: 1, the guess alone; more, points of the parameters' ranges too.",
    )
    load_cases: Annotated[dict[Name, TrainingCase], Field(min_length=1)] | None = Field(
        None,
        description="Trainings that the layout has to serve together, by name: all that it is placed for, where they are given; "
        "null: the one under `loads` as stated, under which validation runs in any case.",
    )
    weights: Literal["normalised", "thesis"] = Field(
        "normalised",
        description="Of the trace. normalised: every unknown starts at 1; thesis: the plain trace, which orders by units.",
    )
    damping_slope: bool = Field(
        True,
        description="Whether the layout allows for damping that changes with a parameter. false: the columns of the thesis as "
        "printed, (5.30) and (5.32), where it does not; the filter has it in any case.",
    )
    installation: Literal["avoid", "ignore"] = Field(
        "avoid",
        description="Errors of installation, by `tolerances`. avoid: of the layouts for exact gauges and for such errors as "
        "noise of the readings, the one of least expected σ; ignore: the layout for exact gauges, as the thesis has it.",
    )
    symmetry: Symmetry | None = expert(
        None, description="Place gauges in mirrored pairs; those without a mirror are left out."
    )


class Cases(Section):
    """Which unknowns could be distinguished (tables 6.1, 6.2): the unknown loads, or all where all are known, the moduli and the
    densities, in every combination."""

    frequencies: tuple[Frequency, ...] = Field(
        (), description="Excitations to compare beside the training run: every load a sine of this frequency [Hz]."
    )


class Filter(Section):
    """The filter itself, in validation and estimation; the σ that place expects is its σ."""

    method: Literal["bank", "extended", "sigma-point"] = Field(
        "bank",
        description="bank: parameters are constants, and a bank of linear filters gives their distribution, of up to three "
        "exactly, of more by normal densities beside their weakest direction; extended: "
        "the extended Kalman filter of the thesis, which is overconfident of parameters that are hardly seen; sigma-point: the "
        "same with regressions over points of the parameters for Jacobians. σ of these two holds no tolerances.",
    )
    drift: bool | None = expert(
        None,
        description="Whether parameters drift by their process_noise_scale in the extended or the sigma-point filter; null: in "
        "the extended one only, as in the thesis. In a bank they are constants.",
    )
    compare: bool | None = Field(
        None,
        description="Whether a bank over parameters is compared with the other two filters on the same samples: where their σ "
        "does not allow for what it finds. null: in the test of validate, and in estimate of up to 20 000 steps, as it takes "
        "some 2 ms a step.",
    )
    scheme: Literal["exact", "trapezoidal", "implicit_euler"] = expert(
        "exact",
        description="Time step: exact for every mode, or a rule whose bias of frequency and damping is printed.",
    )
    form: Literal["joseph", "square_root"] = expert(
        "joseph",
        description="Of the covariance of the extended filter; square_root for noise so small that joseph loses its digits.",
    )
    iterations: int = expert(
        1,
        ge=1,
        le=50,
        description="Of the update of the extended filter [-]: 1 is the Kalman filter's; matters for accelerometers only.",
    )


Export = Literal["nastran", "abaqus", "catman", "labview", "mat"]


class Datum(AxesSection):
    """Where a workshop measures from, in the deck's coordinates."""


class Report(Section):
    """The page, and the files for the workshop and for other programs."""

    format: Literal["html"] = Field("html", description="Kind of page.")
    remark: str = Field("", max_length=500, description="A text of yours on the page, line by line.")
    datum: Datum = with_defaults(
        Datum,
        "Where places of gauges are measured from, in the deck's unit of length: on the page and the sheets, in workshop.csv and "
        "workshop.unv.",
    )
    exports: tuple[Export, ...] = expert(
        (),
        description="Files for other programs. nastran: SET cards of the elements below the gauges, gauges-nastran.inc; abaqus: "
        "*ELSET of them, gauges-abaqus.inp; catman, labview: a table of the channels to set up by hand, channels-catman.txt, "
        "channels-labview.txt; mat: the linear augmented model with the rows of the layout, model.mat.",
    )
    gauge_factor: Annotated[Positive | None, GAUGE_FACTOR] = expert(
        None, description="Gauge factor in tables of channels [-]; null: that of gauges.type, else blank."
    )
    resistance: Annotated[Positive | None, RESISTANCE] = expert(
        None, description="Resistance of a gauge in tables of channels [ohm]; null: that of gauges.type, else blank."
    )


class PlacementConfig(NamedRun, Damped):
    """From a finite-element mesh to a certified strain-gauge layout. SI units unless a field says otherwise."""

    kind: Literal["placement"] = Field(description="Which pipeline.")
    mesh: MeshFile = Field(description="The finite-element model.")
    parameters: dict[Name, MaterialParameter] = Field({}, description="Material properties that stay free, by name.")
    loads: Annotated[dict[Name, LoadSection], Field(min_length=1)] = Field(description="Loads, by name.")
    solver: Literal["direct", "slepc"] = expert(
        "direct",
        description="Who factorises the stiffness, for modes and static responses. direct: this process, by PARDISO; slepc: "
        "processes of MPI, by SLEPc and MUMPS, where one machine has too little memory or time; which launcher and how many "
        "processes say STRAINSIGHT_MPI and STRAINSIGHT_MPI_PYTHON in the environment, and no config.",
    )
    rom: ReducedModelSection = with_defaults(ReducedModelSection, "The parametric reduced model.")
    train: Train = Field(description="The training run.")
    gauges: Gauges = Field(description="Candidates and their noise.")
    tolerances: StatedTolerances = with_defaults(
        Tolerances, "How exactly gauges are installed and the model is known, or none: exactly."
    )
    motion_sensors: dict[Name, MotionSensors] = Field(
        {}, description="Accelerometers and displacement sensors, by name."
    )
    screen: Screen = with_defaults(Screen, "Which candidates enter the elimination.")
    process_noise: ProcessNoise = with_defaults(ProcessNoise, "Process noise of the filter.")
    observe: Cases = with_defaults(Cases, "Which unknowns could be distinguished.")
    place: PlaceSection = Field(description="The elimination.")
    filter: Filter = with_defaults(Filter, "The filter itself.")
    validation: Validate = Field(alias="validate", description="The filter on simulated measurements.")
    estimate: Estimate | None = Field(None, description="The filter on measurements of a test.")
    report: Report = with_defaults(Report, "The page, and the files for the workshop and for other programs.")
