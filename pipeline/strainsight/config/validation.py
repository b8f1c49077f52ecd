"""What a validation assumes for reality, and what it tries."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    Count,
    Duration,
    Name,
    NotNegative,
    ParameterValue,
    Positive,
    Section,
    TimeStep,
    with_defaults,
)
from strainsight.config.plausible import MISPLACED, RELATIVE_STD, Plausible


class Truth(Section):
    """What stands for reality in the validation."""

    model: Literal["full", "modes", "rich", "rom"] = Field(
        "rich",
        description="full: the whole finite-element model in time; modes: many modes and static terms; rich: that, with "
        "damping and gauges that are off by what `tolerances` say, drawn by the seed; rom: the filter's own model.",
    )
    modes: Count = Field(60, ge=1, description="Modes of the truth model [-].")
    parameters: dict[Name, ParameterValue] = Field(
        {}, description="True values [Pa, kg/m³, or 1 for a factor]; a parameter left out is at its guess."
    )
    damping_factor: Annotated[NotNegative | None, Plausible(0.01, 100.0)] = Field(
        None, description="rich: true damping over the filter's [-], the same in every mode; null: by `tolerances`."
    )
    gauge_offset: Annotated[NotNegative | None, MISPLACED] = Field(
        None, description="rich: how far every gauge is misplaced [m], always alike; null: by `tolerances`."
    )
    gauge_rotation: Annotated[NotNegative | None, Plausible(0.01, 45.0, "deg")] = Field(
        None, description="rich: how far every gauge is turned [deg], always alike; null: by `tolerances`."
    )


class Sweeps(Section):
    """Studies of one change at a time, each a run of the layout's filter on the layout's own measurement."""

    time_steps: tuple[TimeStep, ...] = Field((), description="Other time steps of filter and samples [s].")
    process_noise: Annotated[tuple[Positive, ...], Plausible(1e-9, 1e9)] = Field(
        (), description="Factors on all process noise of the filter [-]."
    )
    wrong_parameters: Annotated[
        dict[Name, Annotated[tuple[Positive, ...], Field(min_length=1)]], Plausible(0.1, 10.0)
    ] = Field({}, description="Factors on a parameter that the filter takes as known: 0.9 is ten per cent too low [-].")


class Validate(Section):
    """The filter on simulated measurements."""

    truth: Truth = with_defaults(Truth, "What stands for reality.")
    time_step: TimeStep = Field(description="Time step of the filter [s].")
    duration: Duration = Field(description="Length of the measurement [s].")
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = Field(
        description="Initial σ of every unknown, relative to its guess or amplitude [-]."
    )
    random_sets: Annotated[int, Plausible(0, 1000)] = Field(
        10, ge=0, description="Random gauge sets to compare with, from all candidates and from the pool [-]."
    )
    noise_factors: Annotated[tuple[Positive, ...], Plausible(1e-6, 1e6)] = Field(
        (0.1, 5.0), description="Other noise levels to try, relative to the stated one [-]."
    )
    repeats: Count = Field(20, ge=1, description="Seeds and starting values to repeat with [-].")
    sweeps: Sweeps = with_defaults(Sweeps, "Changes of the filter, one at a time.")
