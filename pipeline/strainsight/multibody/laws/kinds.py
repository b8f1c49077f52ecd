"""The force laws between two frames, under the names that a config has for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from strainsight.multibody.forces import RelativeElement
from strainsight.multibody.laws.actuators import actuator, torque
from strainsight.multibody.laws.friction import friction
from strainsight.multibody.laws.linear import bushing
from strainsight.multibody.laws.spring import spring
from strainsight.multibody.laws.torsion import torsion

LAWS: Mapping[str, Callable[..., RelativeElement]] = {
    "spring": spring,
    "bushing": bushing,
    "torsion": torsion,
    "friction": friction,
    "torque": torque,
    "actuator": actuator,
}
"""Name → (name of the force, first frame, second frame, the keys of its section) → element."""
