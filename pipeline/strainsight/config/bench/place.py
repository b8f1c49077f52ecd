"""Where strain gauges go on a flexible body of a bench, so that its unknown loads are known best."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import Name, NotNegative, Positive, Section
from strainsight.config.gauges import BondedGauge, Direction, GaugeSites, PrincipalDirection
from strainsight.config.layout import Keep, LayoutSettings
from strainsight.config.names import FlexibleName
from strainsight.config.plausible import INSTANT, NOISE, PRICE, SIZE, STRAIN, Plausible

Layout = Literal["place", "random"]
"""Which layout a strain sensor takes from the placement."""


class CandidateSensor(Section):
    """A sensor of the bench among the candidates, each of its three components one."""

    noise: Annotated[Positive | tuple[Positive, Positive, Positive], NOISE] = Field(
        description="σ of a sample [m or m/s²], one for all three components or one each."
    )
    price: Annotated[NotNegative, PRICE] = Field(1.0, description="Price of a component, in the unit of place.budget.")


class BenchPlace(GaugeSites, LayoutSettings):
    """Gauges of a flexible body, placed for the unknown inputs and the parameters that `estimate` estimates."""

    body: FlexibleName = Field(description="Name of the flexible body.")
    fixed: tuple[BondedGauge, ...] = Field((), description="Gauges that are already bonded; they count in place.keep.")
    sensors: dict[Name, CandidateSensor] = Field(
        {},
        description="Displacement sensors and accelerometers that may stand beside gauges, by their names under `sensors`: "
        "motion (position), relative (its displacements, without the tilts) or acceleration. They keep no spacing.",
    )
    keep: Keep = 4
    noise: Annotated[Positive, STRAIN] = Field(
        description="Noise standard deviation of a sample of every gauge [strain]."
    )
    direction: Direction = Field(
        default_factory=lambda: PrincipalDirection(type="principal", angles=(0.0, 45.0, 90.0, 135.0)),
        description="Measuring directions of the candidates, one gauge each; principal: of the static strains under the unknown "
        "inputs, each as strong as the others.",
    )
    pool: Annotated[int, Field(ge=1), Plausible(1, 1e5)] = Field(
        300,
        description="Candidates that enter the elimination beside the bonded ones [-]: the strongest under each unknown "
        "in turn.",
    )
    search: Literal["all", "pool"] = Field(
        "all",
        description="all: bound and proof are over all candidates, and those that a better layout could have by that bound "
        "enter, too; pool: layout, bound and proof are of the pool alone.",
    )
    spacing: Annotated[NotNegative, SIZE] = Field(
        0.0, description="Least distance between those that are strongest under one input [m]."
    )
    poses: Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=100), INSTANT] = Field(
        (0.0,),
        description="Instants of the run, each with the pose in equilibrium under its loads and drives, that the gauges have to "
        "serve [s].",
    )
    aggregate: Literal["mean", "worst"] = Field("mean", description="How poses are put together.")
    random: int = Field(4, ge=0, le=1000, description="Layouts drawn from all candidates, to compare with [-].")

    @property
    def bonded(self) -> int:
        """How many gauges are there already: each grid of a rosette is one."""
        return sum(len(gauge.angles) for gauge in self.fixed)
