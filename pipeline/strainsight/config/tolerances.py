"""Tolerances of installation, loads and model; settings of the validation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    GAIN,
    MISALIGNED,
    MISPLACED,
    RELATIVE_STD,
    STRAIN,
    Count,
    Name,
    NotNegative,
    ParameterValue,
    Plausible,
    Positive,
    Section,
    TimeSpan,
    TimeStep,
    expert,
    with_defaults,
)


class GaugeTolerances(Section):
    """Standard deviations of the errors of gauge installation; 0 means exact."""

    position: Annotated[NotNegative, MISPLACED] = Field(
        0.002,
        description="Standard deviation of the location of a gauge in each of two directions along the surface [m]; typically 2 "
        "mm for a location marked by hand.",
    )
    angle: Annotated[float, MISALIGNED] = expert(
        2.0,
        ge=0,
        le=45,
        description="Standard deviation of the direction of a gauge, or of an accelerometer about each axis [deg].",
    )
    gain: Annotated[float, GAIN] = Field(
        0.01,
        ge=0,
        le=0.5,
        description="Relative standard deviation of the gain of a sensor: gauge factor and lead wires, or sensitivity of an "
        "accelerometer [-]. Default for a structure with gauges.type and without motion_sensors: √(t² + (1 Ω/R)²), with the "
        "tolerance t of the gauge factor and the resistance R.",
    )
    transverse: Annotated[float, GAIN] = expert(
        0.005, ge=0, le=0.5, description="Standard deviation of the transverse sensitivity K_t of a strain gauge [-]."
    )


class Tolerances(GaugeTolerances):
    """Standard deviations of the errors of gauge installation, load application and model; 0 means exact. A simulated test with
    model error samples the errors from these standard deviations."""

    common_gain: Annotated[float, GAIN] = expert(
        0.005,
        ge=0,
        le=0.5,
        description="Relative standard deviation of a gain error common to all strain gauges, from bridge supply, amplifier and "
        "the gauge factor of one batch [-].",
    )

    offset: Annotated[NotNegative, STRAIN] = expert(
        0.0,
        description="Standard deviation of the constant offset of each strain channel, independent of the other channels "
        "[strain].",
    )
    drift: Annotated[NotNegative, STRAIN] = Field(
        0.0,
        description="Standard deviation of the zero drift of a strain channel at the end of the record, linear in time "
        "[strain]. Use 0 for records that are short compared to the warm-up time of the amplifier.",
    )
    temperature: Annotated[NotNegative, Plausible(0.001, 500.0, "K")] = expert(
        0.0,
        description="Standard deviation of the temperature rise of the part at the end of the record, linear in time [K]. The "
        "temperature rise is common to all gauges; each gauge reads `thermal_output` per kelvin.",
    )
    thermal_output: Annotated[NotNegative, Plausible(1e-9, 1e-4, "strain/K")] = expert(
        1e-6,
        description="Thermal output common to all strain gauges, a value and not a standard deviation [strain/K]; 1e-6 for foil "
        "gauges compensated for the material, near room temperature. The thermal output stated by the manufacturer may be "
        "subtracted from the readings beforehand.",
    )
    thermal_spread: Annotated[NotNegative, Plausible(1e-9, 1e-4, "strain/K")] = expert(
        1.4e-7,
        description="Standard deviation of the thermal output among the strain gauges of one batch [strain/K].",
    )
    load_angle: Annotated[float, MISALIGNED] = Field(
        1.0,
        ge=0,
        le=45,
        description="Standard deviation of the direction of a load about each of two perpendicular axes [deg]; 1° for a rod "
        "or actuator aligned by eye and spirit level.",
    )
    load_position: Annotated[NotNegative, MISPLACED] = Field(
        0.002,
        description="Standard deviation of the point of application of a load in each of two directions perpendicular to the "
        "line of action [m]. The offset of the point adds a moment. Typically 2 mm for a location marked by hand.",
    )
    load_gain: Annotated[float, GAIN] = expert(
        0.005,
        ge=0,
        le=0.5,
        description="Relative standard deviation of the measured value of a known load, from load cell and amplifier [-]. ISO "
        "7500-1 permits ±1 % for class 1 and ±0.5 % for class 0.5.",
    )
    mesh: Annotated[NotNegative, Plausible(0.1, 10.0)] = expert(
        0.0,
        description="Factor on the estimated mesh error of each strain gauge, which then is its standard deviation [-]. The "
        "estimate is the difference of nodally averaged strain and element strain at the gauge. Use 1 for coarse meshes; 0: the "
        "strain of the mesh is exact.",
    )
    damping: Annotated[float, Plausible(1.0, 10.0)] = Field(
        1.5,
        ge=1,
        le=100,
        description="Uncertainty of the damping ratio ζ of each mode, as a factor [-]: σ of ln ζ is the logarithm of this "
        "factor. 1: exact damping.",
    )
    frequency: Annotated[float, Plausible(0.0, 0.05)] = expert(
        0.01,
        ge=0,
        le=0.2,
        description="Relative standard deviation of a common factor on all natural frequencies [-]; static responses do not "
        "change. The frequency of each single mode has an additional relative standard deviation of half this value. "
        "Example: a density error of 1 % changes frequencies by 0.5 %. Use 0 for a model updated to measured frequencies.",
    )
    load_mass: Annotated[float, Plausible(0.0, 0.1)] = expert(
        0.01,
        ge=0,
        le=0.5,
        description="Standard deviation of the mass that the model lacks at each point of unknown forces (load cell, fixture, "
        "part of the exciter), relative to the mass of the structure [-]. An unknown load cannot be distinguished from the "
        "inertia of such a mass, which also biases a modulus. Use 0 if `mesh.point_masses` contains these masses.",
    )
    model: Annotated[float, GAIN] = expert(
        0.0,
        ge=0,
        le=0.5,
        description="Relative standard deviation of a common factor on the whole stiffness [-]. It has no effect if a modulus "
        "or a stiffness_factor is estimated.",
    )
    discrepancy: Annotated[float, GAIN] = expert(
        0.02,
        ge=0,
        le=0.5,
        description="Standard deviation of the errors of a reading that the other tolerances do not cover, at every sample, "
        "relative to the RMS reading of the channel [-]. Examples: second-order effects of the tolerances, and truncation of "
        "the reduced model. If all loads are known, the grid filter adds this error to the measurement noise.",
    )
    treat: Literal["consider", "estimate"] = expert(
        "consider",
        description="Treatment of the errors from `tolerances` in the estimation of motion and loads. With `consider`: the "
        "errors increase σ and reduce the filter gains, but are not estimated (Schmidt-Kalman filter). With `estimate`: the "
        "errors are estimated from the measurements; these estimates may include other model errors. The estimation of "
        "parameters always integrates over all errors.",
    )


StatedTolerances = Annotated[
    Annotated[Tolerances, Tag("tolerances")] | Annotated[Literal["none"], Tag("none")],
    Discriminator(lambda value: "tolerances" if isinstance(value, dict | Tolerances) else "none"),
]

NONE = Tolerances.model_validate(dict.fromkeys(Tolerances.model_fields, 0) | {"damping": 1, "treat": "consider"})
"""Tolerances of exact gauges, loads and models."""


def tolerances_of(tolerances: Tolerances | Literal["none"]) -> Tolerances:
    """Tolerances of a config; exact by default."""
    return NONE if tolerances == "none" else tolerances


class TruthSection(Section):
    """Model of the simulated test in the stage `validate`."""

    model: Literal["full", "modes", "perturbed", "rom"] = Field(
        "perturbed",
        description="Model of the simulated test. With `full`: the whole finite-element model. With `modes`: many modes "
        "(`validate.truth.modes`) and static corrections. With `perturbed`: as `modes`, with errors of model, gauges and "
        "loads sampled from `tolerances`. With `rom`: the reduced model of the filter.",
    )
    modes: Count = Field(
        60, ge=1, description="With `model: modes` or `model: perturbed`: number of modes that simulate the test [-]."
    )
    parameters: dict[Name, ParameterValue] = Field(
        {},
        description="Parameter values of the simulated test, by parameter name [Pa, kg/m³, or 1 for a factor]; default: the "
        "guess.",
    )


class Sweeps(Section):
    """Studies with one changed setting of the filter at a time, with the simulated measurements of the placed layout."""

    time_steps: tuple[TimeStep, ...] = expert(
        (),
        description="Further time steps of the filter [s], each in a separate filter run. For each time step, measurements "
        "with this sampling interval are simulated.",
    )
    process_noise: Annotated[tuple[Positive, ...], Plausible(1e-9, 1e9)] = expert(
        (), description="Factors on the whole covariance of the process noise, each in a separate filter run [-]."
    )
    wrong_parameters: Annotated[
        dict[Name, Annotated[tuple[Positive, ...], Field(min_length=1)]], Plausible(0.1, 10.0)
    ] = expert(
        {},
        description="For parameters that are not estimated: factors on the value in the filter, by parameter name [-]. Example: "
        "with 0.9, the filter uses a value 10 % below that of the simulated test. Each factor is a separate filter run.",
    )


@dataclass(frozen=True)
class Studies:
    """Number of repeated runs, number of random layouts in each of two groups, and factors on the noise."""

    repeats: int
    random_sets: int
    noise_factors: tuple[float, ...]


class Validate(TimeSpan):
    """Validation of the filter with simulated measurements."""

    truth: TruthSection = with_defaults(TruthSection, "Model of the simulated test.")
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = Field(
        description="Initial standard deviation of every unknown, by name, relative to the guess of the parameter or to the "
        "amplitude of the load [-]."
    )
    random_sets: Annotated[int | None, Plausible(0, 1000)] = Field(
        None,
        ge=0,
        description="Number of random layouts for comparison with the placed layout [-], in each of two groups: from all "
        "candidates, and from the candidates selected by `screen`. Null: 10, or 0 if parameters and loads are estimated without "
        "a known load, because σ is then invalid.",
    )
    noise_factors: Annotated[tuple[Positive, ...] | None, Plausible(1e-6, 1e6)] = Field(
        None,
        description="Factors on the noise σ of all sensors, each in an additional filter run [-]. Null: 0.1 and 5, or none as "
        "for `random_sets`.",
    )
    repeats: Annotated[int | None, Plausible(1, 10_000)] = Field(
        None,
        ge=1,
        description="Number of repeated filter runs with other noise samples and initial values [-]. Null: 20, or 1 as for "
        "`random_sets`.",
    )
    sweeps: Sweeps = expert(
        default_factory=Sweeps, description="Studies with one changed setting of the filter at a time."
    )
