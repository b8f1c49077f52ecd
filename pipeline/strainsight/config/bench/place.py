"""Where strain gauges go on a flexible body of a bench, so that its unknown loads are known best."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from strainsight.config.base import NotNegative, Positive
from strainsight.config.gauges import Direction, GaugeSites, PrincipalDirection
from strainsight.config.layout import Keep, LayoutSettings, layout_problems
from strainsight.config.names import FlexibleName
from strainsight.config.problem import Problem
from strainsight.config.zones import zone_problems

Layout = Literal["place", "random"]
"""Which layout a strain sensor takes from the placement."""


class BenchPlace(GaugeSites, LayoutSettings):
    """Gauges of a flexible body, placed for the unknown inputs of `estimate`."""

    body: FlexibleName = Field(description="Name of the flexible body.")
    keep: Keep = 4
    noise: Positive = Field(description="Noise standard deviation of a sample of every gauge [strain].")
    direction: Direction = Field(
        default_factory=lambda: PrincipalDirection(type="principal", angles=(0.0, 45.0, 90.0, 135.0)),
        description="Measuring directions of the candidates, one gauge each; principal: of the static strains under the unknown "
        "inputs, each as strong as the others.",
    )
    pool: Annotated[int, Field(ge=1)] = Field(
        300,
        description="Candidates that enter the elimination beside the bonded ones [-]: the strongest under each unknown input "
        "in turn.",
    )
    spacing: NotNegative = Field(
        0.0, description="Least distance between those that are strongest under one input [m]."
    )
    random: int = Field(4, ge=0, le=1000, description="Layouts drawn from all candidates, to compare with [-].")

    @property
    def bonded(self) -> int:
        """How many gauges are there already: each grid of a rosette is one."""
        return sum(len(gauge.angles) for gauge in self.fixed)


def place_problems(config: Any) -> Iterator[Problem]:
    """What `place` and the sensors that use it demand of the rest of a bench."""
    place = config.place
    if place is not None:
        if config.estimate is None or not config.estimate.inputs:
            yield Problem(
                "place", "no input is unknown", "name the loads to place for under estimate.inputs", at_key=True
            )
        if place.pool + place.bonded < place.keep:
            yield Problem("place.pool", f"{place.pool} candidates for {place.keep} gauges", "take a larger pool")
        inputs = () if config.estimate is None else tuple(config.estimate.inputs)
        yield from layout_problems(place, inputs, "estimate.inputs", place.bonded, "place.fixed")
        yield from zone_problems("place.include", place.include)
        yield from zone_problems("place.exclude", place.exclude)
    for name, sensor in config.sensors.items():
        if sensor.type == "strain":
            yield from _layout(f"sensors.{name}", sensor, place)


def _layout(key: str, sensor: Any, place: Any) -> Iterator[Problem]:
    if (sensor.layout is None) == (not sensor.gauges):
        what = "neither is given" if sensor.layout is None else "both are given"
        yield Problem(key, f"gauges and layout: {what}", "give one of them", at_key=True)
    if sensor.layout is None:
        return
    if place is None:
        yield Problem(f"{key}.layout", "nothing is placed", "give the section place, or gauges")
    elif sensor.body != place.body:
        yield Problem(f"{key}.body", f"gauges are placed on '{place.body}'", f"name '{place.body}', or give gauges")
    elif sensor.layout == "random" and place.random == 0:
        yield Problem(f"{key}.layout", "no layout is drawn at random", "set place.random to 1 or more")
