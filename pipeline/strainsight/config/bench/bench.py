"""Config of `kind: bench`: simulation of a multibody test bench, and placement of its gauges."""

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
from strainsight.config.layout import SEARCH, Keep, LayoutSettings, Search

Layout = Literal["place", "random"]
"""Layout of the placement that a strain sensor uses."""


class CandidateSensor(Priced):
    """A displacement sensor or accelerometer for the placement; each of its three components is one candidate."""

    noise: Annotated[Positive | tuple[Positive, Positive, Positive], NOISE] = expert(
        description="Noise standard deviation of one sample of the sensor [m or m/s²]: one value for all three components, or "
        "a list with one value for each component."
    )


class OnFlexibleBody(Section):
    """Key shared by all sections that refer to a flexible body."""

    body: FlexibleName = Field(description="Name of the flexible body.")


class BenchPlace(OnFlexibleBody, GaugeSites, LayoutSettings):
    """Gauge placement on a flexible body, for the unknown loads and the parameters of `estimate`."""

    fixed: tuple[BondedGauge, ...] = expert(
        (),
        description="Gauges that are already bonded to the body. The number of gauges in `place.keep` includes these gauges.",
    )
    sensors: dict[Name, CandidateSensor] = expert(
        {},
        description="Candidate displacement sensors and accelerometers, by their names in the section `sensors`. Possible "
        "types: `motion` with `quantity: position`, `relative` (displacements only, no tilts), `acceleration`. Minimum "
        "distances between gauges do not apply to these sensors.",
    )
    keep: Keep = 4
    noise: Annotated[Positive, STRAIN] = Field(
        description="Noise standard deviation of one sample of every gauge [strain]."
    )
    direction: Direction = Field(
        default_factory=lambda: PrincipalDirection(type="principal", angles=(0.0, 45.0, 90.0, 135.0)),
        description="Measuring directions of the candidate gauges; each direction at a location is one candidate. With "
        "`principal`: principal directions of the static strain under the loads in `estimate.inputs`, each load "
        "scaled to the same largest strain.",
    )
    pool: Annotated[int, Field(ge=1), Plausible(1, 1e5)] = expert(
        300,
        description="Number of candidate gauges with which the backward elimination starts (the pool) [-]; bonded gauges are "
        "not counted. The pool is filled in rounds. For each unknown load or parameter and each instant in `poses`, a round "
        "adds the remaining candidate with the largest static strain due to this unknown.",
    )
    search: Search = expert("all", description=SEARCH)
    spacing: Annotated[NotNegative, SIZE] = Field(
        0.0,
        description="Smallest distance between two candidates that are added to the pool (`place.pool`) for the same unknown "
        "[m].",
    )
    poses: Annotated[tuple[NotNegative, ...], Field(min_length=1, max_length=100), INSTANT] = expert(
        (0.0,),
        description="Instants of the simulation for which the gauges are placed [s]. At each instant, the bench is in static "
        "equilibrium under the loads and driven positions of that instant.",
    )
    random: int = expert(
        4,
        ge=0,
        le=1000,
        description="Number of layouts sampled at random from all candidates, for comparison with the optimised layout [-].",
    )

    @property
    def bonded(self) -> int:
        """Number of bonded gauges; each grid of a rosette is one."""
        return sum(len(gauge.angles) for gauge in self.fixed)


class StrainSensorSection(OnFlexibleBody, Snapped):
    """Strain gauges on a flexible body."""

    type: Literal["strain"] = Field(description="Kind of sensor: strain gauges.")
    gauges: tuple[BondedGauge, ...] = Field(
        (), description="Bonded gauges of this sensor; empty: the gauges of the layout that the key `layout` selects."
    )
    layout: Layout | None = Field(
        None,
        description="Layout from the stage `place`, instead of a list in `gauges`. With `place`: the optimised layout. With "
        "`random`: the first random layout.",
    )
    zeroed: bool = Field(
        False,
        description="`true`: subtract the first simulated reading of each gauge from all its readings (zero balance).",
    )


class RelativeSensor(Between):
    """Motion of the second frame relative to the first frame, in the axes of the first frame: three displacements, and tilts
    about the y and z axes."""

    type: Literal["relative"] = Field(description="Kind of sensor: relative motion of two frames.")


class MotionSensor(AtFrame):
    """Position, velocity or axis direction of a frame, in global axes."""

    type: Literal["motion"] = Field(description="Kind of sensor: motion of a frame.")
    quantity: Literal["position", "velocity", "x_axis", "y_axis", "z_axis"] = expert(
        "position",
        description="Measured quantity: position [m] or velocity [m/s] of the origin of the frame, or direction of one axis "
        "of the frame [-].",
    )


class AccelerationSensor(AtFrame):
    """Acceleration of the origin of a frame, in the axes of the frame (accelerometer) or in global axes."""

    type: Literal["acceleration"] = Field(description="Kind of sensor: accelerometer.")
    axes: Literal["own", "global"] = expert(
        "own", description="Axes of the measured components: axes of the frame (`own`), or global axes (`global`)."
    )
    gravity: bool = expert(
        True,
        description="`true`: acceleration minus gravity, the reading of a real accelerometer; at rest, the reading is 1 g "
        "upwards. `false`: acceleration of the frame, without gravity.",
    )


class ReactionSensor(Section):
    """Force and moment of a joint on its second frame, in the axes of the first frame; the moment is about the origin of the
    second frame. The sensor is for the simulation only, not for the filter."""

    type: Literal["reaction"] = Field(description="Kind of sensor: joint force and moment.")
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
"""Unit of the components, by sensor type or motion quantity; of a strain sensor, the unit of every gauge."""


def units_of(sensor: Sensor) -> tuple[str, ...]:
    """Unit of every component of a sensor; of a strain sensor, of every gauge."""
    return UNITS.get(sensor.quantity, ("1",) * 3) if isinstance(sensor, MotionSensor) else UNITS[sensor.type]


class Simulate(TimeSpan):
    """Time simulation."""

    method: Literal["second_order", "thesis"] = Field(
        "second_order",
        description="Time integration method. With `second_order`: two implicit stages per step; the error is proportional "
        "to the square of the time step. With `thesis`: implicit Euler method; the error is proportional to the time step.",
    )
    tolerance: Annotated[Positive | None, Plausible(1e-14, 0.1)] = expert(
        None,
        description="Largest permitted integration error of the motion of each body over the whole simulation [-], relative "
        "to the largest norm of the coordinates of this body. For a rotation, the value is the error in rad. Each step is halved "
        "until another halving changes the motion by less than this value divided by the number of steps. The loads are "
        "evaluated at all intermediate instants. Null: fixed steps.",
    )
    start: Literal["equilibrium", "as_given"] = expert(
        "equilibrium",
        description="Initial state. With `equilibrium`: static equilibrium under the loads at t = 0. With `as_given`: poses "
        "and velocities in `bodies`, projected onto the joint constraints.",
    )
    allow_unstable: bool = expert(
        False,
        description="`true`: accept an unstable equilibrium as initial state, such as an inverted pendulum.",
    )
    snap_tolerance: Annotated[Positive, Plausible(1e-9, 0.1, "m")] = expert(
        0.005,
        description="Largest permitted displacement of a body when its initial pose is projected onto the joint constraints [m]. "
        "A larger displacement is an error. The projection may also rotate the body by at most 0.02 rad, and change its "
        "initial velocity and spin by at most 1 %.",
    )


class SurfaceField(OnFlexibleBody):
    """Displacement, strain and stress of the surface of a flexible body over time, stored with its mesh for ParaView (VTKHDF)."""

    of: Literal["simulate", "estimate"] = Field(
        "simulate",
        description="Motion for the stress and strain of the surface: the simulated motion (`simulate`), or the estimated "
        "motion with the estimated moduli (`estimate`).",
    )
    every: Annotated[int | None, Plausible(1, 1e6)] = expert(
        None, ge=1, description="Number of time steps between two stored instants [-]; null: computed from `instants`."
    )
    instants: int | None = Field(
        None,
        ge=2,
        le=10_000,
        description="Number of stored instants, evenly spaced over the simulation [-]; null: 50, or computed from `every`.",
    )
    allowable: Stress | None = expert(
        None,
        description="Allowable von Mises stress of the body [Pa]. The results page starts with a warning if the largest "
        "stress exceeds this value. Null: no comparison.",
    )

    def problems(self) -> Iterator[Problem]:
        if self.every is not None and self.instants is not None:
            yield Problem("every", "'every' and 'instants' are both set", "remove one of the two keys")


class BenchConfig(NamedRun, BearingLoads):
    """Rigid and flexible bodies, joints, bearings and loads over time. All values are in SI units unless stated otherwise."""

    kind: Literal["bench"] = Field(description="Which pipeline.")
    bodies: Annotated[dict[Name, Body], Field(min_length=1)] = Field(description="Bodies, by name.")
    frames: Annotated[dict[Name, FrameSection], Field(min_length=1)] = Field(
        description="Frames on bodies and on the ground, by name."
    )
    joints: dict[Name, Joint] = Field({}, description="Joints, by name.")
    bearings: dict[Name, BearingSection] = Field({}, description="Bearings, by name.")
    forces: dict[Name, Force] = Field({}, description="Forces, by name.")
    sensors: dict[Name, Sensor] = Field({}, description="Sensors, by name.")
    simulate: Simulate = Field(description="Time simulation.")
    place: BenchPlace | None = Field(None, description="Placement of gauges for the unknown loads and parameters.")
    field: SurfaceField | None = Field(None, description="Strain and stress of the surface of a body over time.")
    estimate: BenchEstimateSection | None = Field(
        None, description="Estimation of loads and parameters from the sensors."
    )

    @property
    def flexible(self) -> dict[str, FlexibleBodySection]:
        """Flexible bodies, by name."""
        return {name: body for name, body in self.bodies.items() if isinstance(body, FlexibleBodySection)}

    @property
    def driven(self) -> bool:
        """Whether the bench has a joint with a prescribed motion."""
        return any(isinstance(joint, Driven) for joint in self.joints.values())

    @property
    def estimator(self) -> BenchEstimateSection:
        """The section `estimate`, or an error."""
        assert self.estimate is not None
        return self.estimate

    @property
    def filter_step(self) -> float:
        """Time step of filter and samples [s]."""
        return (self.estimate and self.estimate.time_step) or self.simulate.time_step

    @property
    def filter_duration(self) -> float:
        """Duration of the estimate [s]."""
        return (self.estimate and self.estimate.duration) or self.simulate.duration
