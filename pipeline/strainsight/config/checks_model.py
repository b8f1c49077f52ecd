"""What one field of a config demands of another: mesh, parameters, loads."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.base import Problem
from strainsight.config.mesh import Results
from strainsight.config.placement import GuessFrom, PlacementConfig, RayleighDamping
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import did_you_mean

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
            if term.parameter not in config.parameters:
                remedy = did_you_mean(
                    term.parameter, config.parameters, f"parameters: {', '.join(config.parameters) or 'none'}"
                )
                yield Problem(f"{key}.parameter", f"'{term.parameter}' is no parameter", remedy)
            elif config.parameters[term.parameter].property not in wanted:
                yield Problem(
                    f"{key}.parameter",
                    f"'{term.parameter}' is a {config.parameters[term.parameter].property}",
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
    given = {
        "mesh.matrices": config.mesh.matrices is not None,
        "mesh.free": config.mesh.free,
        "mesh.sections": bool(config.mesh.sections),
        "gauges.given": config.gauges.given is not None,
    }
    for key in (key for key, is_set in given.items() if is_set):
        what = "mesh.results has the motion of a structure that is held, on the surface of the mesh"
        yield Problem(key, what, "remove one of the two keys", at_key=True)
    for i, support in enumerate(config.mesh.supports):
        if support.stiffness is not None:
            what = "the stiffness is in mesh.results"
            yield Problem(f"mesh.supports.{i}.stiffness", what, "make the results with the spring", at_key=True)
    for name, own in results.loads.items():
        key = f"mesh.results.loads.{name}"
        if name not in config.loads:
            remedy = did_you_mean(name, config.loads, f"loads: {', '.join(config.loads)}")
            yield Problem(key, f"'{name}' is no load", remedy, at_key=True)
        if own.applied == 0:
            yield Problem(f"{key}.applied", "a load of nothing", "give its size in that step, in the unit of the load")
    for name in results.at:
        if name not in config.parameters:
            remedy = did_you_mean(name, config.parameters, f"parameters: {', '.join(config.parameters) or 'none'}")
            yield Problem(f"mesh.results.at.{name}", f"'{name}' is no parameter", remedy, at_key=True)
    yield from _second_results(config, results)
    for kind, properties in (("stiffness", ("youngs_modulus", "stiffness_factor")), ("mass", ("density",))):
        own_names = [name for name, own in config.parameters.items() if own.property in properties]
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


def _second_results(config: PlacementConfig, results: Results) -> Iterator[Problem]:
    """Its parameter is a stiffness or density of some regions, its loads are those of the first set."""
    second, key = results.second, "mesh.results.second"
    if second is None:
        return
    own = config.parameters.get(second.parameter)
    if own is None:
        known = f"parameters: {', '.join(config.parameters) or 'none'}"
        remedy = did_you_mean(second.parameter, config.parameters, known)
        yield Problem(f"{key}.parameter", f"'{second.parameter}' is no parameter", remedy)
    elif own.property not in ("youngs_modulus", "stiffness_factor", "density") or own.region is None:
        what = f"'{second.parameter}' is {'a ' + own.property if own.region is not None else 'of all regions'}"
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
        if name not in config.loads:
            remedy = did_you_mean(name, config.loads, f"loads: {', '.join(config.loads)}")
            yield Problem(f"{key}.loads.{name}", f"'{name}' is no load", remedy, at_key=True)
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
    for name, own in config.parameters.items():
        if own.property == "density" and not any(load.gravity or load.rotation for load in config.loads.values()):
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
