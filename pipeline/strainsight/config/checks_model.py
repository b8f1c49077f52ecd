"""Consistency checks between fields of a config: mesh, parameters, loads, candidates, bonded gauges, layout limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from strainsight.config.base import Problem, known
from strainsight.config.gauges import AbsoluteNoise, BondedBridge, type_problems
from strainsight.config.mesh import ResultsSection
from strainsight.config.placement import GuessFrom, PlacementConfig, RayleighDamping
from strainsight.config.tolerances import tolerances_of

DAMPING = "damping_factor"


def matrix_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check that imported matrices depend on exactly the parameters of the config."""
    matrices = config.mesh.matrices
    if matrices is not None and config.mesh.free:
        what = "cannot be combined with mesh.matrices, since a free structure needs an assembled model"
        yield Problem("mesh.free", what, "remove one of the two keys")
    if matrices is not None and config.mesh.mass is not None:
        yield Problem("mesh.mass", "the mass comes from mesh.matrices", "remove one of the two keys")
    for name, load in config.loads.items():
        if matrices is not None and (load.gravity or load.rotation):
            what = "mesh.matrices does not contain the positions of the masses"
            yield Problem(f"loads.{name}", what, "define the load as forces of the deck (deck_load)", at_key=True)
    if matrices is None:
        return
    named: set[str] = set()
    for kind, terms in (("stiffness", matrices.stiffness), ("mass", matrices.mass)):
        for i, term in enumerate(terms):
            key = f"mesh.matrices.{kind}.{i}"
            if term.parameter is None:
                if term.at is not None:
                    yield Problem(f"{key}.at", "`at` is set without `parameter`", "set the parameter, or remove `at`")
                continue
            named.add(term.parameter)
            wanted = {"stiffness": ("youngs_modulus", "stiffness_factor"), "mass": ("density",)}[kind]
            yield from known(f"{key}.parameter", term.parameter, config.parameters, "parameter")
            parameter = config.parameters.get(term.parameter)
            if parameter is not None and parameter.property not in wanted:
                what = f"'{term.parameter}' is a {parameter.property}"
                yield Problem(f"{key}.parameter", what, f"use a {' or '.join(wanted)} for a {kind} term")
    for name in config.parameters:
        if name not in named and named <= set(config.parameters) and config.parameters[name].property != DAMPING:
            what = "no term of mesh.matrices depends on this parameter"
            yield Problem(f"parameters.{name}", what, f"set parameter: {name} for one term", at_key=True)


def result_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check that imported modes and responses scale as a whole, with one modulus or factor and with one density."""
    results = config.mesh.results
    if results is None:
        return
    others = {
        "mesh.matrices": config.mesh.matrices is not None,
        "mesh.free": config.mesh.free,
        "mesh.sections": bool(config.mesh.sections),
        "gauges.strain_operator": config.gauges.strain_operator is not None,
    }
    for key in (key for key, is_set in others.items() if is_set):
        what = "cannot be combined with mesh.results, which apply to a supported structure with the nodes of the mesh"
        yield Problem(key, what, "remove the key, or mesh.results", at_key=True)
    for i, support in enumerate(config.mesh.supports):
        if support.stiffness is not None:
            what = "the stiffness comes from mesh.results"
            remedy = "include the spring in the model that produced the results"
            yield Problem(f"mesh.supports.{i}.stiffness", what, remedy, at_key=True)
    for name, entry in results.loads.items():
        key = f"mesh.results.loads.{name}"
        yield from known(key, name, config.loads, "load", at_key=True)
        if entry.magnitude == 0:
            what = "the load magnitude is zero"
            yield Problem(f"{key}.magnitude", what, "set the load magnitude of that step, in the unit of the load")
    for name in results.at:
        yield from known(f"mesh.results.at.{name}", name, config.parameters, "parameter", at_key=True)
    yield from _second_results(config, results)
    for kind, properties in (("stiffness", ("youngs_modulus", "stiffness_factor")), ("mass", ("density",))):
        own_names = [name for name, entry in config.parameters.items() if entry.property in properties]
        for name in own_names[1:]:
            what = f"the {kind} of mesh.results is already proportional to {own_names[0]}"
            yield Problem(f"parameters.{name}", what, "remove one of the two parameters", at_key=True)
    for name, own_parameter in config.parameters.items():
        if own_parameter.property not in ("youngs_modulus", "stiffness_factor", "density", DAMPING):
            what = f"mesh.results does not contain the dependence on a {own_parameter.property}"
            yield Problem(
                f"parameters.{name}.property", what, "use a stiffness_factor of all regions, or remove mesh.results"
            )
        if own_parameter.springs is not None:
            what = "mesh.results does not contain the stiffness of the springs"
            yield Problem(f"parameters.{name}.springs", what, "replace mesh.results by mesh.matrices", at_key=True)


def _second_results(config: PlacementConfig, results: ResultsSection) -> Iterator[Problem]:
    """Check that a second set has a stiffness or density of some regions as parameter, and the loads of the first set."""
    second, key = results.second, "mesh.results.second"
    if second is None:
        return
    parameter = config.parameters.get(second.parameter)
    if parameter is None:
        yield from known(f"{key}.parameter", second.parameter, config.parameters, "parameter")
    elif parameter.property not in ("youngs_modulus", "stiffness_factor", "density") or parameter.region is None:
        kind = f"is a {parameter.property}" if parameter.region is not None else "applies to all regions"
        what = f"'{second.parameter}' {kind}"
        remedy = (
            "use a youngs_modulus, stiffness_factor or density of some regions; other parameters need no second set"
        )
        yield Problem(f"{key}.parameter", what, remedy)
    if second.loads is None:
        for name, load in results.loads.items():
            if load.file is not None:
                what = f"the response to {name} in the first set is in a separate file"
                yield Problem(f"{key}.loads", what, "set the loads of the second set, each with its file", at_key=True)
        return
    for name, load in second.loads.items():
        yield from known(f"{key}.loads.{name}", name, config.loads, "load", at_key=True)
        if load.magnitude == 0:
            yield Problem(
                f"{key}.loads.{name}.magnitude", "the load magnitude is zero", "set the magnitude in that step"
            )


MODULI = ("youngs_modulus", "e1", "e2", "g12", "g1z", "g2z")
RESERVED = {"constant", "factors", "roots", "weights"}  # other datasets of an affine operator


def model_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Yield the inconsistencies between the fields that define the model."""
    yield from _names(config)
    yield from _free(config)
    yield from _static(config)
    yield from damping_problems(config)
    yield from _places(config)
    yield from matrix_problems(config)
    yield from result_problems(config)
    for name, parameter in config.parameters.items():
        if isinstance(parameter.guess, GuessFrom) and parameter.guess.source == config.name:
            yield Problem(
                f"parameters.{name}.guess.from", "a run cannot use its own estimate as guess", "name another run"
            )


def _static(config: PlacementConfig) -> Iterator[Problem]:
    """Check for parameters and sensors that need inertia, with train.model: static."""
    if config.train.model != "static":
        return
    for name, parameter in config.parameters.items():
        if parameter.property == "density" and not any(load.gravity or load.rotation for load in config.loads.values()):
            what = "a static model (train.model: static) does not depend on the density"
            yield Problem(f"parameters.{name}.property", what, "set train.model: dynamic, or add a gravity load")
    for name, sensors in config.motion_sensors.items():
        if sensors.quantity == "acceleration":
            what = "a static model (train.model: static) has no accelerations"
            yield Problem(
                f"motion_sensors.{name}.quantity", what, "set train.model: dynamic, or remove the accelerometers"
            )


def _names(config: PlacementConfig) -> Iterator[Problem]:
    for name in config.parameters:
        if name in config.loads:
            yield Problem(f"loads.{name}", "a parameter has the same name", "use different names", at_key=True)
    for section, names in (("parameters", config.parameters), ("loads", config.loads)):
        for name in names:
            if name in RESERVED:
                yield Problem(f"{section}.{name}", f"the name '{name}' is reserved", "use another name", at_key=True)


def _places(config: PlacementConfig) -> Iterator[Problem]:
    """Check that a parameter has regions, springs or matrix terms, and a ply modulus a material."""
    matrices = config.mesh.matrices
    for name, parameter in config.parameters.items():
        key = f"parameters.{name}"
        if parameter.material is not None and parameter.property not in MODULI:
            what = f"a ply material does not have the property {parameter.property}"
            yield Problem(f"{key}.material", what, f"remove the key, or set property to one of {', '.join(MODULI)}")
        if parameter.springs is not None:
            if matrices is not None:
                yield Problem(
                    f"{key}.springs", "springs are part of mesh.matrices", "define a separate term for the springs"
                )
            elif parameter.region is not None:
                yield Problem(f"{key}.springs", "region is set as well", "define two parameters, or remove one key")
            if parameter.property != "stiffness_factor":
                what = f"springs do not have the property {parameter.property}"
                yield Problem(f"{key}.property", what, "use property: stiffness_factor, which scales their stiffness")
        elif parameter.property == DAMPING:
            continue
        elif parameter.region is None and matrices is None and config.mesh.results is None:
            remedy = "set the id or name of a region, a list of regions, or the names of springs (springs)"
            yield Problem(f"{key}.region", "missing", remedy, at_key=True)
        elif parameter.region is not None and matrices is not None:
            yield Problem(
                f"parameters.{name}.region", "mesh.matrices defines the terms of the parameter", "remove the key"
            )


def _free(config: PlacementConfig) -> Iterator[Problem]:
    """Check for sensors and loads that a free structure cannot have, since its position depends on the whole past."""
    if not config.mesh.free:
        return
    soft = "use strain gauges, or replace mesh.free by soft springs (mesh.supports, stiffness)"
    for name, sensors in config.motion_sensors.items():
        what = "sensors measure the rigid-body motion, which a free structure (mesh.free) omits"
        yield Problem(f"motion_sensors.{name}", f"{sensors.quantity} {what}", soft, at_key=True)


def damping_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check the parameters with property damping_factor."""
    names = [name for name, parameter in config.parameters.items() if parameter.property == DAMPING]
    for name in names[1:]:
        what = f"{names[0]} is already a factor on the damping"
        yield Problem(f"parameters.{name}", what, "remove one of the two parameters", at_key=True)
    for name in names:
        parameter = config.parameters[name]
        if parameter.region is not None:
            what = f"a {DAMPING} scales `damping` in every mode; it has no region"
            yield Problem(f"parameters.{name}.region", what, "remove the key")
        law = config.damping
        none = not (law.alpha or law.beta) if isinstance(law, RayleighDamping) else not law.ratio
        if none:
            what = f"a {DAMPING} has no effect, since `damping` is zero"
            yield Problem(
                f"parameters.{name}.property", what, "set `damping` to the expected value, such as ratio: 0.01"
            )
        spread = tolerances_of(config.tolerances).damping
        if name in config.place.estimate and spread > 1:
            what = (
                "a common factor of all modes is estimated, but each mode has its own damping tolerance, a "
                f"factor of {spread:g} (tolerances.damping)"
            )
            remedy = "set tolerances: {damping: 1} for constant ratios between modes, or do not estimate the factor"
            yield Problem(f"parameters.{name}.property", what, remedy)
        if config.train.model == "static":
            what = "a static model (train.model: static) does not depend on the damping"
            yield Problem(f"parameters.{name}.property", what, "set train.model: dynamic")


LARGEST_NOISE = 0.01
"""[strain] Noise of a sample above which another unit is assumed."""
LARGEST_ROSETTE = 3
"""Grids."""


def gauge_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Yield the inconsistencies between the fields of the candidates and of the layout limits."""
    gauges = config.gauges
    yield from _strain_rows(config)
    if isinstance(gauges.noise_std, AbsoluteNoise) and (value := gauges.noise_std.value) > LARGEST_NOISE:
        what = f"{value:g} m/m is {100 * value:g} % strain"
        yield Problem("gauges.noise_std.value", what, f"use m/m: {value:g} um/m is {1e-6 * value:.1e} m/m")
    grids = 0 if gauges.direction is None or not gauges.rosette else len(gauges.direction.angles)
    if grids == 1:
        yield Problem(
            "gauges.rosette", "a rosette needs more than one grid", "set gauges.direction.angles, such as [0, 45, 90]"
        )
    if grids > LARGEST_ROSETTE:
        yield Problem(
            "gauges.direction.angles", f"a rosette with {grids} grids is not supported", "use at most three grids"
        )
    if gauges.direction is not None:
        yield from type_problems(gauges, len(gauges.direction.angles) if gauges.rosette else 1)
    for name, sensors in config.motion_sensors.items():
        directions = [axis if axis == "normal" else _unit(axis) for axis in sensors.axes]
        if any(a in directions[:i] for i, a in enumerate(directions)):
            yield Problem(f"motion_sensors.{name}.axes", "one axis repeats another axis", "remove the repeated axis")
    yield from _mirrored(config)
    yield from _bridges(config)
    yield from _count(config)


def channels_of_a_gauge(config: PlacementConfig) -> int:
    """Largest number of signals of one gauge: of a rosette, or of a triaxial accelerometer."""
    direction = config.gauges.direction
    counts = [len(sensors.axes) for sensors in config.motion_sensors.values()]
    counts += [len(bonded.angles) for bonded in config.gauges.fixed if not isinstance(bonded, BondedBridge)]
    counts += [LARGEST_ROSETTE] * (config.gauges.fixed_file is not None)  # nobody has read it yet
    return max([len(direction.angles) if direction is not None and config.gauges.rosette else 1, *counts])


def _strain_rows(config: PlacementConfig) -> Iterator[Problem]:
    """Check for keys that need a mesh surface, if candidates are rows of the strain operator."""
    gauges = config.gauges
    if gauges.strain_operator is None:
        if gauges.direction is None:
            yield Problem(
                "gauges.direction",
                "missing",
                "set {type: axis, axis: [1, 0, 0]}, or gauges.strain_operator",
                at_key=True,
            )
        return
    if config.mesh.matrices is None:
        yield Problem(
            "gauges.strain_operator",
            "rows of the strain operator need imported matrices",
            "set mesh.matrices",
            at_key=True,
        )
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
                "gauges.direction": "the candidates already have directions",
                "gauges.bridge": "the row of a bridge already contains the sum of its arms",
            }.get(key, "this key needs a mesh surface")
            yield Problem(key, f"cannot be combined with gauges.strain_operator: {what}", "remove the key", at_key=True)


def _bridges(config: PlacementConfig) -> Iterator[Problem]:
    """Check candidates that are bridges: a bridge is one channel, and has no mirror image."""
    if config.gauges.bridge is None:
        return
    if config.gauges.rosette:
        yield Problem(
            "gauges.rosette", "a rosette cannot be an arm of a bridge", "remove the key, or gauges.bridge", at_key=True
        )
    if config.place.symmetry is not None:
        what = "candidates with bridges cannot be placed in mirrored pairs"
        remedy = "remove the key, or gauges.bridge; bonded bridges are permitted"
        yield Problem("place.symmetry", what, remedy, at_key=True)


def _unit(axis: Sequence[float]) -> tuple[float, ...]:
    """Direction of an axis without its length and sign, rounded."""
    length = sum(x * x for x in axis) ** 0.5 or 1.0
    first = next((x for x in axis if x), 1.0)
    return tuple(round(x / length * (1 if first > 0 else -1), 9) + 0.0 for x in axis)


def _mirrored(config: PlacementConfig) -> Iterator[Problem]:
    """Check that the angles include their mirror images: mirroring changes +45° to −45°."""
    direction = config.gauges.direction
    if config.place.symmetry is None or direction is None:
        return
    angles = {round(angle % 180, 6) for angle in direction.angles}
    if angles != {round(-angle % 180, 6) for angle in direction.angles}:
        listed = ", ".join(f"{-angle:g}" for angle in direction.angles)
        what = f"the angles do not contain their mirror images, {listed}"
        remedy = "with place.symmetry, use angles such as [0, 60, 120], [0, 90] or [-45, 0, 45]"
        yield Problem("gauges.direction.angles", what, remedy)


def _count(config: PlacementConfig) -> Iterator[Problem]:
    keep, names = config.place.keep, tuple(dict.fromkeys(config.place.estimate))
    kinds = {"inputs" if name in config.loads else "parameters" for name in names}
    what = f"unknown {kinds.pop()}" if len(kinds) == 1 else "unknowns"
    signals = keep * channels_of_a_gauge(config)
    if signals < len(names):
        yield Problem(
            "place.keep",
            f"{keep} gauge{'s' * (keep != 1)} cannot observe {len(names)} {what} ({', '.join(names)})",
            f"set keep to at least {-(-len(names) * keep // signals)}, or estimate fewer "
            f"{what.removeprefix('unknown ')}",
        )
    pool = config.screen.keep
    if pool != "all" and keep > pool:
        what = f"keep is {keep}, larger than the pool of {pool} candidates (screen.keep)"
        yield Problem("place.keep", what, f"set keep to at most {pool}, or increase screen.keep")
