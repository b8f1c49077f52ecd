"""What a layout may be and what makes it good: the keys that the placement on a structure and that on a bench share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import Count, Name, NotNegative, Positive, Section
from strainsight.config.plausible import DURATION, PRICE, SIZE, Plausible
from strainsight.config.problem import Problem
from strainsight.config.zones import Zone, zone_problem
from strainsight.errors import did_you_mean

Keep = Annotated[
    Count,
    Field(ge=1, description="Gauges to bond [-], those already bonded among them; with a budget at most so many."),
]


class ZoneLimit(Section):
    """So many gauges in a zone, and no more."""

    zone: Zone = Field(description="The zone.")
    count: Annotated[int, Plausible(0, 1000)] = Field(ge=0, description="Most gauges in it [-].")


class LayoutSettings(Section):
    """The layout: its size, its limits, its criterion, and how it is searched."""

    keep: Keep
    criterion: Literal["trace", "log_determinant", "worst_eigenvalue"] = Field(
        "trace",
        description="What the layout makes small, of the covariance of the unknowns: the sum of their variances; the volume of "
        "what stays uncertain, which no unit changes; or the variance of the combination of them that is known worst.",
    )
    metric_over: tuple[Name, ...] = Field(
        (),
        description="Unknowns that the criterion covers; empty: all. The others are estimated beside them, however "
        "badly.",
    )
    minimum_spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Least distance between gauges of the layout [m]. With gauges.type of a structure: the longer side of its "
        "carrier.",
    )
    at_most: tuple[ZoneLimit, ...] = Field((), description="Most gauges in some zones.")
    budget: Annotated[Positive | None, PRICE] = Field(
        None, description="What the gauges may cost together, by their `price`; null: no limit."
    )
    certificate: bool = Field(True, description="Compute a lower bound on what any layout of that size can reach.")
    exchange: bool = Field(True, description="Exchange gauges after the elimination until none helps.")
    optimise: Literal["metric", "worst_failure"] = Field(
        "metric", description="metric: the criterion; worst_failure: the same after the worst failure of any one gauge."
    )
    prove: Annotated[NotNegative, DURATION] = Field(
        0.0,
        description="Time for a branch and bound that improves the layout or proves it best [s]; 0: none. What it reaches "
        "without a proof depends on the machine.",
    )


def layout_problems(
    place: LayoutSettings, unknowns: Sequence[str], among: str, bonded: int, key: str
) -> Iterator[Problem]:
    """Contradictions between the limits, the criterion and the search; unknowns: those that the key `among` names; bonded:
    how many gauges are there already by the config's `key`."""
    for i, limit in enumerate(place.at_most):
        yield from zone_problem(f"place.at_most.{i}.zone", limit.zone)
    for i, name in enumerate(place.metric_over):
        if name not in unknowns:
            remedy = did_you_mean(name, unknowns, f"{among} has {', '.join(unknowns)}")
            yield Problem(f"place.metric_over.{i}", f"'{name}' is not estimated", remedy)
        elif name in place.metric_over[:i]:
            yield Problem(f"place.metric_over.{i}", f"'{name}' is named twice", "remove one of them")
    if place.prove > 0 and place.optimise != "metric":
        yield Problem("place.prove", "a proof is of the metric, not of the worst failure", "remove one of the two keys")
    if place.keep < bonded:
        what = f"{place.keep} gauges, and {bonded} are bonded already ({key})"
        yield Problem("place.keep", what, f"keep at least {bonded}")
