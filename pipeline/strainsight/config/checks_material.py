"""What one field of a material demands of another, and of two directions that span a plane."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.base import Problem, Vector
from strainsight.config.mesh import Material
from strainsight.config.placement import PlacementConfig, RayleighDamping
from strainsight.config.tolerances import tolerances_of

PARALLEL = 1e-6
"""sin² of the least angle between the two axes of a datum or a material, 0.06°."""


def material_problems(key: str, own: Material) -> Iterator[Problem]:
    """Three of each constant, or one E and ν."""
    three = {
        "youngs_modulus": isinstance(own.youngs_modulus, tuple),
        "poisson_ratio": isinstance(own.poisson_ratio, tuple),
        "shear_modulus": own.shear_modulus is not None,
    }
    if any(three.values()) and not all(three.values()):
        lacking = ", ".join(name for name, there in three.items() if not there)
        yield Problem(
            key,
            f"{', '.join(name for name, there in three.items() if there)} of an orthotropic material, and not {lacking}",
            "give [E1, E2, E3], [ν12, ν13, ν23] and [G12, G13, G23], or one E and ν and no shear_modulus",
            at_key=True,
        )
    elif own.axes is not None and not all(three.values()):
        yield Problem(f"{key}.axes", "an isotropic material has no axes", "remove the key", at_key=True)
    if own.axes is not None:
        yield from plane_problems(f"{key}.axes", own.axes.x, own.axes.y)


def plane_problems(key: str, x: Vector, y: Vector) -> Iterator[Problem]:
    """Two directions x and y below a key have to span a plane."""
    for axis, direction in {"x": x, "y": y}.items():
        if not any(direction):
            yield Problem(f"{key}.{axis}", "a direction of length zero", "give a vector such as [1, 0, 0]")
            return
    along = sum(a * b for a, b in zip(x, y, strict=True))
    if along**2 >= (1 - PARALLEL) * sum(a * a for a in x) * sum(b * b for b in y):
        yield Problem(
            f"{key}.y", f"{list(y)} runs along x, {list(x)}", "give another direction in the plane of x and y"
        )


DAMPING = "damping_factor"


def damping_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Of parameters that are a damping_factor."""
    names = [name for name, own in config.parameters.items() if own.property == DAMPING]
    for name in names[1:]:
        what = f"the damping is multiplied by {names[0]} already"
        yield Problem(f"parameters.{name}", what, "keep one of the two", at_key=True)
    for name in names:
        own = config.parameters[name]
        if own.region is not None:
            what = f"a {DAMPING} multiplies `damping` in every mode: it has no region"
            yield Problem(f"parameters.{name}.region", what, "remove the key")
        law = config.damping
        none = not (law.alpha or law.beta) if isinstance(law, RayleighDamping) else not law.ratio
        if none:
            what = f"a {DAMPING} of no damping (`damping` is zero)"
            yield Problem(f"parameters.{name}.property", what, "give `damping` what is expected, such as ratio: 0.01")
        spread = tolerances_of(config.tolerances).damping
        if name in config.place.estimate and spread > 1:
            what = (
                f"one factor of all modes, which each may be damped {spread:g} times more or less (tolerances.damping)"
            )
            remedy = "state that they keep their ratios, tolerances: {damping: 1}, or do not estimate it"
            yield Problem(f"parameters.{name}.property", what, remedy)
        if config.train.model == "static":
            what = "damping, which a structure without inertia does not feel (train.model: static)"
            yield Problem(f"parameters.{name}.property", what, "train.model: dynamic")
