"""Time histories of the loads and driven joints of a bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import DRIVEN, DURATION, Duration, NotNegative, Plausible, Problem, Section, expert
from strainsight.config.loads import MultiSineSection, RecordedSection, SineSection, SweepSection


class ConstantSection(Section):
    """Constant signal u(t) = value."""

    type: Literal["constant"] = Field(description="Kind of signal: a constant.")
    value: Annotated[float, DRIVEN] = Field(
        description="Value of the signal [N or N m; for a drive: rad, m, rad/s or m/s]."
    )


class RampSection(Section):
    """Smooth transition from `start` (a) to `end` (b), u = a + (b − a)(10s³ − 15s⁴ + 6s⁵) with s = (t − `begin`)/`duration`. The
    first and second time derivatives of u are continuous."""

    type: Literal["ramp"] = Field(description="Kind of signal: a smooth transition.")
    start: Annotated[float, DRIVEN] = Field(
        0.0, description="Value of the signal before the transition [N or N m; for a drive: rad, m, rad/s or m/s]."
    )
    end: Annotated[float, DRIVEN] = Field(
        description="Value of the signal after the transition [N or N m; for a drive: rad, m, rad/s or m/s]."
    )
    begin: Annotated[NotNegative, DURATION] = Field(
        0.0, description="Start time of the transition from `start` to `end` [s]."
    )
    duration: Duration = Field(description="Duration of the transition from `start` to `end` [s].")


Signal = Annotated[
    ConstantSection | RampSection | SineSection | SweepSection | MultiSineSection | RecordedSection,
    Field(discriminator="type"),
]


class Drive(Section):
    """Prescribed motion of a driven joint."""

    signal: Signal = Field(
        description="Time history of the prescribed motion [rad or m; with `of: rate`, rad/s or m/s]."
    )
    of: Literal["position", "rate"] = expert(
        "position",
        description="Quantity that `signal` prescribes: position (angle, displacement or length), or rate of the position.",
    )
    start: Annotated[float, Plausible(0.0, 1e3, "rad or m")] = expert(
        0.0, description="With `of: rate`: position at t = 0 [rad or m]."
    )

    def problems(self) -> Iterator[Problem]:
        if self.of == "position" and self.start:
            yield Problem(
                "start", "has no effect: the signal defines the position at t = 0", "remove the key, or set `of: rate`"
            )
        if self.of == "rate" and self.signal.type == "sweep":
            what = "a sweep is not supported with `of: rate`: the position, the integral of a sweep, has no closed form"
            yield Problem(
                "signal", what, "set `of: position`, or save the rate in a CSV file and use a signal with `type: csv`"
            )
