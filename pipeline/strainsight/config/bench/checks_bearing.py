"""What the fields of bearings, their load cases and their curves demand of one another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from strainsight.config.bench.bearing import RADII, Bearing, Curve, LoadCase
from strainsight.config.problem import Problem

LARGEST_PRELOAD = 0.02
"""Share of the ball diameter: as oversize several times what hard steel bears, as clearance a worn-out bearing."""
LEAST_REACH = 1e-9
"""Share of the ball diameter below which a displacement is rounding."""


def bearings_alone(
    bearings: Mapping[str, Bearing], cases: Mapping[str, LoadCase], curves: Sequence[Curve]
) -> Iterator[Problem]:
    """Bearings that cannot be built, cases and curves without any, curves that reach too far."""
    for name, bearing in bearings.items():
        yield from _bearing(f"bearings.{name}", bearing)
    for key, given in (("cases", cases), ("curves", curves)):
        if given and not bearings:
            yield Problem(key, "there is no bearing", f"leave {key} out, or give bearings", at_key=True)
    if bearings:
        for i, curve in enumerate(curves):
            yield from _curve(i, curve, bearings)


def _chosen(entry: Curve, bearings: Mapping[str, Bearing]) -> tuple[str, ...]:
    if entry.bearing is None:
        return tuple(bearings)
    return (entry.bearing,) if isinstance(entry.bearing, str) else entry.bearing


def _bearing(key: str, bearing: Bearing) -> Iterator[Problem]:
    """What `multibody.bearing.geometry` refuses too, for whoever builds a bearing without a config: only here the file, the
    line and all problems can be listed at once, and a config knows no kernel."""
    half = bearing.ball_diameter / 2
    limit = LARGEST_PRELOAD * bearing.ball_diameter
    if abs(bearing.preload) > limit:
        yield Problem(
            f"{key}.preload",
            f"{bearing.preload:g} m is beyond {limit:g} m, {100 * LARGEST_PRELOAD:g} % of the ball diameter",
            "give the oversize of the balls on their radius in metres (clearance: negative); usual are 1e-5 to 1e-4 m",
        )
    for radius in RADII:
        value = getattr(bearing, radius)
        if not value > half:
            yield Problem(
                f"{key}.{radius}",
                f"{value:g} m is not above half the ball diameter, {half:g} m",
                "a groove is wider than its ball: usual radii are 1.03 to 1.06 times half the diameter",
            )
        elif not value > half + bearing.preload and bearing.preload <= limit:
            yield Problem(
                f"{key}.preload",
                f"balls of {half:g} m in radius with {bearing.preload:g} m of oversize do not pass {radius}, {value:g} m",
                f"take less than {value - half:.6g} m, or a wider groove",
            )
    if bearing.ball_diameter * bearing.balls > np.pi * bearing.pitch_diameter:
        yield Problem(
            f"{key}.balls",
            f"{bearing.balls} balls of {bearing.ball_diameter:g} m do not fit on a circle of {bearing.pitch_diameter:g} m",
            f"take at most {int(np.pi * bearing.pitch_diameter / bearing.ball_diameter)}",
        )


def _curve(i: int, curve: Curve, bearings: Mapping[str, Bearing]) -> Iterator[Problem]:
    """A ring moves by no more than a ball, at the pitch circle, and by more than rounding."""
    for name in _chosen(curve, bearings):
        if name not in bearings:
            continue
        bearing = bearings[name]
        tilts = curve.along.startswith("tilt")
        arm, unit = (bearing.pitch_diameter / 2, "rad") if tilts else (1.0, "m")
        most, least = bearing.ball_diameter / arm, LEAST_REACH * bearing.ball_diameter / arm
        if curve.reach > most:
            moved = f"moves the balls of '{name}' by {curve.reach * arm:.4g} m, " if tilts else ""
            yield Problem(
                f"curves.{i}.reach",
                f"{curve.reach:g} {unit} {moved or 'is '}beyond the ball diameter of '{name}', {bearing.ball_diameter:g} m",
                f"take at most {most:.4g} {unit}; a bearing gives way by micrometres to a few millimetres",
            )
        elif curve.reach < least:
            yield Problem(
                f"curves.{i}.reach",
                f"{curve.reach:g} {unit} is below {least:.3g} {unit}, which is rounding beside the balls of '{name}'",
                f"take {1e-4 / arm:.2g} {unit}, say",
            )
