"""The config of `kind: placement`: from a deck to a validated gauge layout."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import Name, NotNegative, Positive, RunName, Section, Seed, Text, with_defaults
from strainsight.config.gauges import Gauges
from strainsight.config.loads import Load
from strainsight.config.mesh import MeshFile

KeepAll = Literal["all"]


class GuessFrom(Section):
    """A guess that another run estimated."""

    source: Text = Field(
        alias="from",
        description="Name of the run (results/NAME/validate.h5), or the path of such a file from the config's folder.",
    )


Guess = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[GuessFrom, Tag("from")],
    Discriminator(lambda value: "from" if isinstance(value, dict | GuessFrom) else "number"),
]


class MaterialParameter(Section):
    """A material property that the reduced model keeps free."""

    property: Literal["youngs_modulus", "density"] = Field(description="Which property: [Pa] or [kg/m³].")
    region: int | Text | Annotated[tuple[int | Text, ...], Field(min_length=1)] | None = Field(
        None, description="Region id (PSOLID id) or name, or a list of them; left out only with mesh.matrices."
    )
    guess: Guess = Field(description="Value before anything is measured [Pa or kg/m³], or {from: another run}.")
    range: tuple[Positive, Positive] = Field(
        description="[lowest, highest] value the reduced model is made for [Pa or kg/m³]."
    )
    process_noise_scale: Positive = Field(
        0.05, description="δ: how fast the filter lets the parameter wander, relative to its guess [1/√s]."
    )


class ModalDamping(Section):
    """The same damping ratio in every mode."""

    type: Literal["modal"] = Field(description="Kind of damping.")
    ratio: float = Field(ge=0, lt=1, description="Damping ratio [-].")


class RayleighDamping(Section):
    """C = αM + βK."""

    type: Literal["rayleigh"] = Field(description="Kind of damping.")
    alpha: NotNegative = Field(description="α [1/s].")
    beta: NotNegative = Field(description="β [s].")


class ReducedModel(Section):
    """The parametric reduced model."""

    modes: int = Field(10, ge=1, description="Modes per parameter sample [-].")
    parameter_samples: int = Field(5, ge=1, description="Samples of the parameter box [-].")
    tolerance: float = Field(1e-8, gt=0, lt=1, description="Share of snapshot energy that may be cut [-].")


class Train(Section):
    """The training run."""

    duration: Positive = Field(description="Length of the training run [s].")
    time_step: Positive = Field(description="Time step [s].")


class Screen(Section):
    """Which candidates enter the elimination."""

    keep: Annotated[int, Field(ge=1)] | KeepAll = Field("all", description="Candidates to keep [-], or 'all'.")
    minimum_spacing: NotNegative = Field(0.0, description="Least distance between kept candidates [m].")


class ProcessNoise(Section):
    """Process noise of the filter."""

    rule: Literal["continuous", "thesis"] = Field(
        "continuous",
        description="continuous: intensities q = κωa²; thesis: (hωa)² a step of train.time_step, whatever κ is.",
    )
    model_error: NotNegative = Field(
        0.01,
        description="Noise on the velocities as a share of the training acceleration [-]: without it the filter is sure and "
        "wrong as soon as the damping is not exact.",
    )


class Place(Section):
    """The elimination."""

    estimate: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(
        description="Unknown loads and parameters to place for."
    )
    keep: int = Field(ge=1, description="Gauges to glue [-].")
    instants: int = Field(20, ge=1, description="Instants of the training run that the model is linearised at [-].")
    aggregate: Literal["mean", "worst"] = Field("mean", description="How the instants are put together.")
    weights: Literal["normalised", "thesis"] = Field(
        "normalised",
        description="normalised: every unknown starts at 1; thesis: the plain trace, which orders by units.",
    )
    certificate: bool = Field(True, description="Compute a lower bound on what any layout of that size can reach.")
    exchange: bool = Field(True, description="Exchange gauges after the elimination until none helps.")
    optimise: Literal["trace", "worst_failure"] = Field(
        "trace", description="trace: the metric; worst_failure: the metric after the worst failure of any one gauge."
    )
    prove: NotNegative = Field(
        0.0,
        description="Time for a branch and bound that improves the layout or proves it best [s]; 0: none. What it reaches "
        "without a proof depends on the machine.",
    )


class Truth(Section):
    """What stands for reality in the validation."""

    model: Literal["modes", "rich", "rom"] = Field(
        "rich",
        description="modes: many modes and static terms; rich: that, with other damping and misplaced gauges; rom: the "
        "filter's own model.",
    )
    modes: int = Field(60, ge=1, description="Modes of the truth model [-].")
    parameters: dict[Name, Positive] = Field(
        {}, description="True values [Pa or kg/m³]; a parameter left out is at its guess."
    )
    damping_factor: NotNegative = Field(1.5, description="rich: true damping over the filter's [-].")
    gauge_offset: NotNegative = Field(0.002, description="rich: how far every gauge is off its place [m].")
    gauge_rotation: NotNegative = Field(2.0, description="rich: how far every gauge is turned [deg].")


class Validate(Section):
    """The filter on simulated measurements."""

    truth: Truth = with_defaults(Truth, "What stands for reality.")
    time_step: Positive = Field(description="Time step of the filter [s].")
    duration: Positive = Field(description="Length of the measurement [s].")
    initial_std: dict[Name, Positive] = Field(
        description="Initial σ of every unknown, relative to its guess or amplitude [-]."
    )
    random_sets: int = Field(
        10, ge=0, description="Random gauge sets to compare with, from all candidates and from the pool [-]."
    )
    noise_factors: tuple[Positive, ...] = Field(
        (0.1, 5.0), description="Other noise levels to try, relative to the stated one [-]."
    )
    repeats: int = Field(20, ge=1, description="Seeds and starting values to repeat with [-].")


class Report(Section):
    """The page."""

    format: Literal["html"] = Field("html", description="Kind of page.")


class PlacementConfig(Section):
    """From a finite-element mesh to a certified strain-gauge layout. SI units unless a field says otherwise."""

    kind: Literal["placement"] = Field(description="Which pipeline.")
    name: RunName = Field(description="Name of the run; its results go to results/NAME.")
    seed: Seed = Field(0, description="Seed of everything that is drawn at random [-].")
    mesh: MeshFile = Field(description="The finite-element model.")
    parameters: dict[Name, MaterialParameter] = Field({}, description="Material properties that stay free, by name.")
    loads: Annotated[dict[Name, Load], Field(min_length=1)] = Field(description="Loads, by name.")
    damping: Annotated[ModalDamping | RayleighDamping, Field(discriminator="type")] = Field(
        description="Structural damping."
    )
    rom: ReducedModel = with_defaults(ReducedModel, "The parametric reduced model.")
    train: Train = Field(description="The training run.")
    gauges: Gauges = Field(description="Candidates and their noise.")
    screen: Screen = with_defaults(Screen, "Which candidates enter the elimination.")
    process_noise: ProcessNoise = with_defaults(ProcessNoise, "Process noise of the filter.")
    place: Place = Field(description="The elimination.")
    validation: Validate = Field(alias="validate", description="The filter on simulated measurements.")
    report: Report = with_defaults(Report, "The page.")
