"""What a model that comes from another program demands of a config: ready matrices, or modes and responses."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.checks_damping import DAMPING
from strainsight.config.mesh import Results
from strainsight.config.placement import PlacementConfig
from strainsight.config.problem import Problem
from strainsight.errors import did_you_mean


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
