"""What one field of a config demands of another: mesh, parameters, loads, candidates, bonded gauges, limits of a layout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from strainsight.config.base import Problem, known
from strainsight.config.gauges import AbsoluteNoise, BondedBridge, type_problems
from strainsight.config.mesh import ResultsSection
from strainsight.config.placement import GuessFrom, PlacementConfig, RayleighDamping
from strainsight.config.tolerances import tolerances_of

DAMPING = "damping_factor"


def matrix_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Ready matrices carry the parameters that the config names, and no others."""
    matrices = config.mesh.matrices
    if matrices is not None and config.mesh.free:
        yield Problem("mesh.free", "is of an assembled model, and mesh.matrices is given", "remove one of the two keys")
    if matrices is not None and config.mesh.mass is not None:
        yield Problem("mesh.mass", "the mass is that of mesh.matrices", "remove one of the two keys")
    for name, load in config.loads.items():
        if matrices is not None and (load.gravity or load.rotation):
            what = "the mass is that of mesh.matrices, which says of no place where it is"
            yield Problem(f"loads.{name}", what, "give the load as forces of the deck (deck_load)", at_key=True)
    if matrices is None:
        return
    named: set[str] = set()
    for kind, terms in (("stiffness", matrices.stiffness), ("mass", matrices.mass)):
        for i, term in enumerate(terms):
            key = f"mesh.matrices.{kind}.{i}"
            if term.parameter is None:
                if term.at is not None:
                    yield Problem(f"{key}.at", "a value of no parameter", "name the parameter, or remove the key")
                continue
            named.add(term.parameter)
            wanted = {"stiffness": ("youngs_modulus", "stiffness_factor"), "mass": ("density",)}[kind]
            yield from known(f"{key}.parameter", term.parameter, config.parameters, "parameter")
            parameter = config.parameters.get(term.parameter)
            if parameter is not None and parameter.property not in wanted:
                yield Problem(
                    f"{key}.parameter",
                    f"'{term.parameter}' is a {parameter.property}",
                    f"the {kind} depends on a {' or '.join(wanted)}",
                )
    for name in config.parameters:
        if name not in named and named <= set(config.parameters) and config.parameters[name].property != DAMPING:
            yield Problem(
                f"parameters.{name}",
                "no term of mesh.matrices belongs to it",
                f"give a term parameter: {name}",
                at_key=True,
            )


def result_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Modes and responses of another program scale as a whole: with one modulus or factor, and with one density."""
    results = config.mesh.results
    if results is None:
        return
    others = {
        "mesh.matrices": config.mesh.matrices is not None,
        "mesh.free": config.mesh.free,
        "mesh.sections": bool(config.mesh.sections),
        "gauges.given": config.gauges.given is not None,
    }
    for key in (key for key, is_set in others.items() if is_set):
        what = "mesh.results has the motion of a structure that is held, on the surface of the mesh"
        yield Problem(key, what, "remove one of the two keys", at_key=True)
    for i, support in enumerate(config.mesh.supports):
        if support.stiffness is not None:
            what = "the stiffness is in mesh.results"
            yield Problem(f"mesh.supports.{i}.stiffness", what, "make the results with the spring", at_key=True)
    for name, entry in results.loads.items():
        key = f"mesh.results.loads.{name}"
        yield from known(key, name, config.loads, "load", at_key=True)
        if entry.applied == 0:
            yield Problem(f"{key}.applied", "a load of nothing", "give its size in that step, in the unit of the load")
    for name in results.at:
        yield from known(f"mesh.results.at.{name}", name, config.parameters, "parameter", at_key=True)
    yield from _second_results(config, results)
    for kind, properties in (("stiffness", ("youngs_modulus", "stiffness_factor")), ("mass", ("density",))):
        own_names = [name for name, entry in config.parameters.items() if entry.property in properties]
        for name in own_names[1:]:
            what = f"the {kind} of mesh.results is proportional to {own_names[0]} already"
            yield Problem(f"parameters.{name}", what, "keep one of the two", at_key=True)
    for name, own_parameter in config.parameters.items():
        if own_parameter.property not in ("youngs_modulus", "stiffness_factor", "density", DAMPING):
            what = f"modes and responses of mesh.results do not say how they change with a {own_parameter.property}"
            yield Problem(f"parameters.{name}.property", what, "give the deck, or free a stiffness_factor of all")
        if own_parameter.springs is not None:
            what = "what a spring adds to the stiffness is not known of mesh.results"
            yield Problem(f"parameters.{name}.springs", what, "give the deck, or mesh.matrices", at_key=True)


def _second_results(config: PlacementConfig, results: ResultsSection) -> Iterator[Problem]:
    """Its parameter is a stiffness or density of some regions, its loads are those of the first set."""
    second, key = results.second, "mesh.results.second"
    if second is None:
        return
    parameter = config.parameters.get(second.parameter)
    if parameter is None:
        yield from known(f"{key}.parameter", second.parameter, config.parameters, "parameter")
    elif parameter.property not in ("youngs_modulus", "stiffness_factor", "density") or parameter.region is None:
        what = (
            f"'{second.parameter}' is {'a ' + parameter.property if parameter.region is not None else 'of all regions'}"
        )
        remedy = (
            "a second set is of a youngs_modulus, stiffness_factor or density of some regions; one of all needs none"
        )
        yield Problem(f"{key}.parameter", what, remedy)
    if second.loads is None:
        for name, load in results.loads.items():
            if load.file is not None:
                what = f"the response to {name} has a file of its own in the first set"
                yield Problem(
                    f"{key}.loads", what, "state the loads of the second set, each with its file", at_key=True
                )
        return
    for name, load in second.loads.items():
        yield from known(f"{key}.loads.{name}", name, config.loads, "load", at_key=True)
        if load.applied == 0:
            yield Problem(f"{key}.loads.{name}.applied", "a load of nothing", "give its size in that step")


MODULI = ("youngs_modulus", "e1", "e2", "g12", "g1z", "g2z")
RESERVED = {"constant", "factors", "roots", "weights"}  # what stands beside the terms of an affine operator in a file


def model_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Contradictions between the fields that make the model."""
    yield from _names(config)
    yield from _free(config)
    yield from _static(config)
    yield from damping_problems(config)
    yield from _places(config)
    yield from matrix_problems(config)
    yield from result_problems(config)
    for name, parameter in config.parameters.items():
        if isinstance(parameter.guess, GuessFrom) and parameter.guess.source == config.name:
            yield Problem(f"parameters.{name}.guess.from", "a run cannot take a guess from itself", "name another run")


def _static(config: PlacementConfig) -> Iterator[Problem]:
    """What no structure without inertia tells."""
    if config.train.model != "static":
        return
    for name, parameter in config.parameters.items():
        if parameter.property == "density" and not any(load.gravity or load.rotation for load in config.loads.values()):
            what = "a density, which a structure without inertia does not feel (train.model: static)"
            yield Problem(f"parameters.{name}.property", what, "train.model: dynamic, or a load that acts on its mass")
    for name, sensors in config.motion_sensors.items():
        if sensors.quantity == "acceleration":
            what = "accelerometers read what train.model: static leaves out"
            yield Problem(f"motion_sensors.{name}.quantity", what, "train.model: dynamic, or remove them")


def _names(config: PlacementConfig) -> Iterator[Problem]:
    for name in config.parameters:
        if name in config.loads:
            yield Problem(
                f"loads.{name}", "a parameter has this name too", "give every unknown a name of its own", at_key=True
            )
    for section, names in (("parameters", config.parameters), ("loads", config.loads)):
        for name in names:
            if name in RESERVED:
                yield Problem(f"{section}.{name}", f"the name '{name}' is taken", "choose another name", at_key=True)


def _places(config: PlacementConfig) -> Iterator[Problem]:
    """A parameter has regions, springs or terms of ready matrices, and of plies a material."""
    matrices = config.mesh.matrices
    for name, parameter in config.parameters.items():
        key = f"parameters.{name}"
        if parameter.material is not None and parameter.property not in MODULI:
            what = f"a {parameter.property} is not of one material of plies"
            yield Problem(f"{key}.material", what, f"remove the key, or give one of {', '.join(MODULI)} for property")
        if parameter.springs is not None:
            if matrices is not None:
                yield Problem(f"{key}.springs", "springs are in mesh.matrices", "give them a term of their own there")
            elif parameter.region is not None:
                yield Problem(f"{key}.springs", "region is given too", "make two parameters of it, or remove one key")
            if parameter.property != "stiffness_factor":
                what = f"springs have no {parameter.property}"
                yield Problem(f"{key}.property", what, "property: stiffness_factor, which multiplies their stiffness")
        elif parameter.property == DAMPING:
            continue
        elif parameter.region is None and matrices is None and config.mesh.results is None:
            remedy = "give a region's id or name, or a list, or the names of springs (springs)"
            yield Problem(f"{key}.region", "missing", remedy, at_key=True)
        elif parameter.region is not None and matrices is not None:
            yield Problem(
                f"parameters.{name}.region", "mesh.matrices say what belongs to the parameter", "remove the key"
            )


def _free(config: PlacementConfig) -> Iterator[Problem]:
    """What a structure without supports cannot have: where it is depends on its whole past, and on nothing that is modelled."""
    if not config.mesh.free:
        return
    soft = "use gauges, or hold it on soft springs (mesh.supports, stiffness) without mesh.free"
    for name, sensors in config.motion_sensors.items():
        what = "reads the rigid motion, which is left out of a free structure (mesh.free)"
        yield Problem(f"motion_sensors.{name}", f"{sensors.quantity} {what}", soft, at_key=True)


def damping_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Of parameters that are a damping_factor."""
    names = [name for name, parameter in config.parameters.items() if parameter.property == DAMPING]
    for name in names[1:]:
        what = f"the damping is multiplied by {names[0]} already"
        yield Problem(f"parameters.{name}", what, "keep one of the two", at_key=True)
    for name in names:
        parameter = config.parameters[name]
        if parameter.region is not None:
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
    grids = 0 if gauges.direction is None or not gauges.rosette else len(gauges.direction.angles)
    if grids == 1:
        yield Problem("gauges.rosette", "a rosette of one grid", "give gauges.direction.angles, such as [0, 45, 90]")
    if grids > LARGEST_ROSETTE:
        yield Problem("gauges.direction.angles", f"a rosette of {grids} grids", "give at most three")
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
