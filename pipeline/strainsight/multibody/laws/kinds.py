"""The force laws between two frames, under the names that a config has for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from strainsight.multibody.forces import RelativeElement
from strainsight.multibody.laws.actuators import actuator, friction, torque
from strainsight.multibody.laws.springs import bushing, spring, torsion

LAWS: Mapping[str, Callable[..., RelativeElement]] = {
    "spring": spring,
    "bushing": bushing,
    "torsion": torsion,
    "friction": friction,
    "torque": torque,
    "actuator": actuator,
}
"""Name → (name of the force, first frame, second frame, the keys of its section) → element."""
