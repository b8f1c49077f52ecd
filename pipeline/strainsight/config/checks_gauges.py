"""What one field of a config demands of another: candidates, bonded gauges, other sensors, limits of a layout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from strainsight.config.base import Problem
from strainsight.config.gauges import AbsoluteNoise, BondedBridge, Gauges, type_problems
from strainsight.config.placement import PlacementConfig

LARGEST_NOISE = 0.01
"""[strain] σ of a sample beyond which it is stated in another unit."""
LARGEST_ROSETTE = 3
"""Grids."""


def gauge_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Contradictions between the fields that make the candidates and the limits of a layout."""
    gauges = config.gauges
    yield from _given(config)
    if isinstance(gauges.noise_std, AbsoluteNoise) and (value := gauges.noise_std.value) > LARGEST_NOISE:
        yield Problem(
            "gauges.noise_std.value",
            f"{value:g} m/m are {100 * value:g} % of strain",
            f"give it in m/m: {value:g} um/m are {1e-6 * value:.1e}",
        )
    yield from _rosette(gauges)
    if gauges.direction is not None:
        yield from type_problems(gauges, len(gauges.direction.angles) if gauges.rosette else 1)
    for name, sensors in config.motion_sensors.items():
        directions = [axis if axis == "normal" else _unit(axis) for axis in sensors.axes]
        if any(a in directions[:i] for i, a in enumerate(directions)):
            yield Problem(f"motion_sensors.{name}.axes", "two axes are the same direction", "remove one of them")
    yield from _mirrored(config)
    yield from _bridges(config)
    yield from _count(config)


def channels_of_a_gauge(config: PlacementConfig) -> int:
    """The most signals that one gauge can give: a rosette, a triaxial accelerometer."""
    direction = config.gauges.direction
    counts = [len(sensors.axes) for sensors in config.motion_sensors.values()]
    counts += [len(bonded.angles) for bonded in config.gauges.fixed if not isinstance(bonded, BondedBridge)]
    counts += [LARGEST_ROSETTE] * (config.gauges.fixed_file is not None)  # nobody has read it yet
    return max([len(direction.angles) if direction is not None and config.gauges.rosette else 1, *counts])


def _given(config: PlacementConfig) -> Iterator[Problem]:
    """Gauges by their strain rows have nothing to do with the surface of a mesh."""
    gauges = config.gauges
    if gauges.given is None:
        if gauges.direction is None:
            yield Problem(
                "gauges.direction", "missing", "give {type: axis, axis: [1, 0, 0]}, or gauges.given", at_key=True
            )
        return
    if config.mesh.matrices is None:
        yield Problem("gauges.given", "strain rows belong to ready matrices", "give mesh.matrices", at_key=True)
    for key, is_set in (
        ("gauges.direction", gauges.direction is not None),
        ("gauges.rosette", gauges.rosette),
        ("gauges.bridge", gauges.bridge is not None),
        ("gauges.type", gauges.type is not None),
        ("gauges.grid_length", gauges.grid_length > 0),
        ("gauges.clearance", isinstance(gauges.clearance, float)),
        ("gauges.fixed", bool(gauges.fixed)),
        ("gauges.fixed_file", gauges.fixed_file is not None),
        ("motion_sensors", bool(config.motion_sensors)),
        ("place.symmetry", config.place.symmetry is not None),
    ):
        if is_set:
            what = {
                "gauges.direction": "given gauges have their own directions",
                "gauges.bridge": "the row of a given bridge is the sum of its arms already",
            }.get(key, "it needs a surface to lie on")
            yield Problem(key, f"{what}, and gauges.given is there", "remove the key", at_key=True)


def _rosette(gauges: Gauges) -> Iterator[Problem]:
    grids = 0 if gauges.direction is None or not gauges.rosette else len(gauges.direction.angles)
    if grids == 1:
        yield Problem("gauges.rosette", "a rosette of one grid", "give gauges.direction.angles, such as [0, 45, 90]")
    if grids > LARGEST_ROSETTE:
        yield Problem("gauges.direction.angles", f"a rosette of {grids} grids", "give at most three")


def _bridges(config: PlacementConfig) -> Iterator[Problem]:
    """A candidate that is a bridge is one channel, and its mirror image would be one of four arms in other places."""
    if config.gauges.bridge is None:
        return
    if config.gauges.rosette:
        yield Problem("gauges.rosette", "a rosette is no arm of a bridge", "remove it, or gauges.bridge", at_key=True)
    if config.place.symmetry is not None:
        yield Problem(
            "place.symmetry",
            "bridges are not placed in mirrored pairs",
            "remove it, or gauges.bridge; bridges that are bonded already may be there",
            at_key=True,
        )


def _unit(axis: Sequence[float]) -> tuple[float, ...]:
    """The direction of an axis without its length and sign, rounded."""
    length = sum(x * x for x in axis) ** 0.5 or 1.0
    first = next((x for x in axis if x), 1.0)
    return tuple(round(x / length * (1 if first > 0 else -1), 9) + 0.0 for x in axis)


def _mirrored(config: PlacementConfig) -> Iterator[Problem]:
    """Mirroring turns an angle of +45° into one of −45°: a gauge has a mirror image only where both are there."""
    direction = config.gauges.direction
    if config.place.symmetry is None or direction is None:
        return
    angles = {round(angle % 180, 6) for angle in direction.angles}
    if angles != {round(-angle % 180, 6) for angle in direction.angles}:
        yield Problem(
            "gauges.direction.angles",
            "mirrored, they become " + ", ".join(f"{-angle:g}" for angle in direction.angles),
            "with place.symmetry give angles such as [0, 60, 120], [0, 90] or [-45, 0, 45]",
        )


def _count(config: PlacementConfig) -> Iterator[Problem]:
    keep, names = config.place.keep, tuple(dict.fromkeys(config.place.estimate))
    kinds = {"inputs" if name in config.loads else "parameters" for name in names}
    what = f"unknown {kinds.pop()}" if len(kinds) == 1 else "unknowns"
    signals = keep * channels_of_a_gauge(config)
    if signals < len(names):
        yield Problem(
            "place.keep",
            f"{keep} gauge{'s' * (keep != 1)} cannot observe {len(names)} {what} ({', '.join(names)})",
            f"keep at least {-(-len(names) * keep // signals)}, or estimate fewer {what.removeprefix('unknown ')}",
        )
    pool = config.screen.keep
    if pool != "all" and keep > pool:
        yield Problem(
            "place.keep",
            f"{keep} is larger than the pool of {pool} (screen.keep)",
            f"keep at most {pool}, or raise screen.keep",
        )
