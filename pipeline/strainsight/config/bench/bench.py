"""The config of `kind: bench`: a multibody bench in time, and where its gauges go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import (
    INSTANT,
    NOISE,
    SIZE,
    STRAIN,
    FlexibleName,
    JointName,
    Name,
    NamedRun,
    NotNegative,
    Plausible,
    Positive,
    Problem,
    Section,
    Stress,
    TimeSpan,
    expert,
)
from strainsight.config.bench.bodies import BearingLoads, BearingSection, Body, FlexibleBodySection, FrameSection
from strainsight.config.bench.connections import AtFrame, Between, Driven, Force, Joint
from strainsight.config.bench.estimate import BenchEstimateSection
from strainsight.config.gauges import BondedGauge, Direction, GaugeSites, Priced, PrincipalDirection, Snapped
from strainsight.config.layout import Keep, LayoutSettings

Layout = Literal["place", "random"]
"""Which layout a strain sensor takes from the placement."""


class CandidateSensor(Priced):
    """A sensor of the bench among the candidates, each of its three components one."""

    noise: Annotated[Positive | tuple[Positive, Positive, Positive], NOISE] = expert(
        description="σ of a sample [m or m/s²], one for all three components or one each."
    )


class OnFlexibleBody(Section):
    """What is on a flexible body."""

    body: FlexibleName = Field(description="Name of the flexible body.")


class BenchPlace(OnFlexibleBody, GaugeSites, LayoutSettings):
    """Gauges of a flexible body, placed for the unknown inputs and the parameters that `estimate` estimates."""

    fixed: tuple[BondedGauge, ...] = expert((), description="Gauges that are already bonded; they count in place.keep.")
    sensors: dict[Name, CandidateSensor] = expert(
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
    pool: Annotated[int, Field(ge=1), Plausible(1, 1e5)] = expert(
        300,
        description="Candidates that enter the elimination beside the bonded ones [-]: the strongest under each unknown "
        "in turn.",
    )
    search: Literal["all", "pool"] = expert(
        "all",
        description="all: bound and proof are over all candidates, and those that a better layout could have by that bound "
        "enter, too; pool: layout, bound and proof are of the pool alone.",
    )
    spacing: Annotated[NotNegative, SIZE] = Field(
        0.0, description="Least distance between those that are strongest under one input [m]."
    )
    poses: Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=100), INSTANT] = expert(
        (0.0,),
        description="Instants of the run, each with the pose in equilibrium under its loads and drives, that the gauges have to "
        "serve [s].",
    )
    random: int = expert(4, ge=0, le=1000, description="Layouts drawn from all candidates, to compare with [-].")

    @property
    def bonded(self) -> int:
        """How many gauges are there already: each grid of a rosette is one."""
        return sum(len(gauge.angles) for gauge in self.fixed)


class StrainSensorSection(OnFlexibleBody, Snapped):
    """Strain gauges bonded on a flexible body."""

    type: Literal["strain"] = Field(description="Kind of sensor.")
    gauges: tuple[BondedGauge, ...] = Field((), description="Where they are bonded; none: as `layout` says.")
    layout: Layout | None = Field(
        None, description="Gauges of the section `place` instead: the placed ones, or the first layout drawn at random."
    )
    zeroed: bool = Field(False, description="true: what they read at the start is taken off.")


class RelativeSensor(Between):
    """Motion of the second frame in the axes of the first: three displacements, and tilts about its y and z axes."""

    type: Literal["relative"] = Field(description="Kind of sensor.")


class MotionSensor(AtFrame):
    """Motion of a frame in global axes."""

    type: Literal["motion"] = Field(description="Kind of sensor.")
    quantity: Literal["position", "velocity", "x_axis", "y_axis", "z_axis"] = expert(
        "position", description="Position [m] or velocity [m/s] of its origin, or the direction of one of its axes [-]."
    )


class AccelerationSensor(AtFrame):
    """Acceleration of a frame's origin, as an accelerometer bonded there reads it, or in global axes."""

    type: Literal["acceleration"] = Field(description="Kind of sensor.")
    axes: Literal["own", "global"] = expert("own", description="Along the axes of the frame, or along global ones.")
    gravity: bool = expert(
        True,
        description="true: less that of gravity, so that at rest it reads 1 g upwards; false: of the motion alone.",
    )


class ReactionSensor(Section):
    """Force and moment that a joint exerts on its second frame, in the axes of the first, about the second's origin;
    simulated only."""

    type: Literal["reaction"] = Field(description="Kind of sensor.")
    joint: JointName = Field(description="Name of the joint.")


Sensor = Annotated[
    StrainSensorSection | RelativeSensor | MotionSensor | AccelerationSensor | ReactionSensor,
    Field(discriminator="type"),
]


UNITS = {
    "strain": ("strain",),
    "relative": ("m", "m", "m", "rad", "rad"),
    "acceleration": ("m/s²",) * 3,
    "reaction": ("N", "N", "N", "N m", "N m", "N m"),
    "position": ("m",) * 3,
    "velocity": ("m/s",) * 3,
}
"""Kind of sensor, or quantity of a motion → unit of every component, of a strain sensor of every gauge."""


def units_of(sensor: Sensor) -> tuple[str, ...]:
    """Unit of every component of a sensor, of a strain sensor of every gauge."""
    return UNITS.get(sensor.quantity, ("1",) * 3) if isinstance(sensor, MotionSensor) else UNITS[sensor.type]


class Simulate(TimeSpan):
    """The simulation in time."""

    method: Literal["second_order", "thesis"] = Field(
        "second_order",
        description="second_order: two implicit stages a step, errors shrink with its square; thesis: implicit Euler, with the "
        "step itself.",
    )
    tolerance: Annotated[Positive | None, Plausible(1e-14, 0.1)] = expert(
        None,
        description="Largest error of the motion that all steps together may make, beside the coordinates of each body (a turn "
        "counts as 1): steps are divided until halving them again changes less, and see the loads at every instant of their "
        "own; null: every step is one.",
    )
    start: Literal["equilibrium", "as_given"] = expert(
        "equilibrium",
        description="equilibrium: the static equilibrium under the loads at t = 0; as_given: poses and velocities of the "
        "bodies, projected onto the joints.",
    )
    allow_unstable: bool = expert(
        False,
        description="true: start from an equilibrium that is left by itself, as of a pendulum that stands on its head.",
    )
    snap_tolerance: Annotated[Positive, Plausible(1e-9, 0.1, "m")] = expert(
        0.005,
        description="How far the joints may move a body from its pose at the start before it is refused [m]; velocities may "
        "change by 1 %.",
    )


class SurfaceField(OnFlexibleBody):
    """Displacement, strain and stress of a flexible body's surface in time, as a grid that ParaView plays."""

    of: Literal["simulate", "estimate"] = Field(
        "simulate", description="Of the simulated motion, or of the estimated one with the estimated moduli."
    )
    every: Annotated[int | None, Plausible(1, 1e6)] = expert(
        None, ge=1, description="Steps between pictures [-]; null: as many as `instants` says."
    )
    instants: int | None = Field(None, ge=2, le=10_000, description="Pictures, evenly from start to end [-]; null: 50.")
    allowable: Stress | None = expert(
        None,
        description="Von Mises stress that the body may carry [Pa]; the page compares the largest one with it and begins with it "
        "where it is exceeded; null: none is stated.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.every is not None and self.instants is not None:
            yield Problem("every", "every and instants are both given", "give one of them")


class BenchConfig(NamedRun, BearingLoads):
    """Rigid and flexible bodies, joints, bearings and loads in time. SI units unless a field says otherwise."""

    kind: Literal["bench"] = Field(description="Which pipeline.")
    bodies: Annotated[dict[Name, Body], Field(min_length=1)] = Field(description="Bodies, by name.")
    frames: Annotated[dict[Name, FrameSection], Field(min_length=1)] = Field(description="Frames on bodies and ground.")
    joints: dict[Name, Joint] = Field({}, description="Joints, by name.")
    bearings: dict[Name, BearingSection] = Field({}, description="Bearings, by name.")
    forces: dict[Name, Force] = Field({}, description="Forces, by name.")
    sensors: dict[Name, Sensor] = Field({}, description="Sensors, by name.")
    simulate: Simulate = Field(description="The simulation in time.")
    place: BenchPlace | None = Field(None, description="Gauges placed for the unknown loads.")
    field: SurfaceField | None = Field(None, description="Strain and stress of a body's surface in time.")
    estimate: BenchEstimateSection | None = Field(None, description="Loads and parameters from the sensors.")

    @property
    def flexible(self) -> dict[str, FlexibleBodySection]:
        """The flexible bodies, by name."""
        return {name: body for name, body in self.bodies.items() if isinstance(body, FlexibleBodySection)}

    @property
    def driven(self) -> bool:
        """Whether a joint follows a history."""
        return any(isinstance(joint, Driven) for joint in self.joints.values())

    @property
    def estimator(self) -> BenchEstimateSection:
        """The section `estimate`, where there is one."""
        assert self.estimate is not None
        return self.estimate

    @property
    def filter_step(self) -> float:
        """Time step of filter and samples [s]."""
        return (self.estimate and self.estimate.time_step) or self.simulate.time_step

    @property
    def filter_duration(self) -> float:
        """Length of the estimate [s]."""
        return (self.estimate and self.estimate.duration) or self.simulate.duration
