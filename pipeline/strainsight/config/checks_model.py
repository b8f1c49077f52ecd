"""What one field of a config demands of another: mesh, parameters, loads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from strainsight.config.base import Problem, exactly_one
from strainsight.config.checks_material import DAMPING, damping_problems, material_problems, plane_problems
from strainsight.config.layout import FOR_EXAMPLE, NO_LENGTH, box_problem
from strainsight.config.loads import Load, Recorded, signal_problems
from strainsight.config.mesh import ElementSection, MeshFile, Results, Support
from strainsight.config.placement import GuessFrom, MaterialParameter, PlacementConfig
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


MODULI = ("youngs_modulus", "e1", "e2", "g12", "g1z", "g2z")
RESERVED = {"constant", "factors", "roots", "weights"}  # what stands beside the terms of an affine operator in a file


def model_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Contradictions between the fields that make the model."""
    yield from _names(config)
    yield from _mesh(config.mesh)
    yield from _free(config)
    yield from _static(config)
    yield from damping_problems(config)
    yield from _places(config)
    yield from matrix_problems(config)
    yield from result_problems(config)
    for name, parameter in config.parameters.items():
        yield from _parameter(f"parameters.{name}", parameter, config.name)
    for name, load in config.loads.items():
        yield from load_problems(f"loads.{name}", load)
    yield from plane_problems("report.datum", config.report.datum.x, config.report.datum.y)


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


def _parameter(key: str, parameter: MaterialParameter, run: str) -> Iterator[Problem]:
    low, high = parameter.range
    if low >= high:
        yield Problem(
            f"{key}.range", f"the lowest value {low:g} is not below the highest {high:g}", "give [lowest, highest]"
        )
    elif isinstance(parameter.guess, float | int) and not low <= parameter.guess <= high:
        yield Problem(
            f"{key}.guess",
            f"{parameter.guess:g} lies outside the range {low:g} to {high:g}",
            f"widen {key}.range, or guess within it",
        )
    if isinstance(parameter.guess, GuessFrom) and parameter.guess.source == run:
        yield Problem(f"{key}.guess.from", "a run cannot take a guess from itself", "name another run")


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


def _mesh(mesh: MeshFile) -> Iterator[Problem]:
    for name, face in mesh.faces.items():
        if not (face.near or face.normal or face.box or face.radius):
            what = "says of no face which it is"
            yield Problem(f"mesh.faces.{name}", what, "give near, normal, box or radius", at_key=True)
        if face.normal is not None and not any(face.normal):
            yield Problem(f"mesh.faces.{name}.normal", NO_LENGTH, FOR_EXAMPLE)
        if face.box is not None:
            yield from box_problem(f"mesh.faces.{name}.box", face.box)
    for name, section in mesh.sections.items():
        yield from _section(f"mesh.sections.{name}", section)
    if mesh.sections and mesh.matrices is not None:
        yield Problem("mesh.sections", "stiffness and mass are those of mesh.matrices", "remove the key", at_key=True)
    for i, support in enumerate(mesh.supports):
        yield from exactly_one(f"mesh.supports.{i}", {"node": support.node, "set": support.set})
        yield from _springs(f"mesh.supports.{i}", support, mesh)
    claimed: dict[object, str] = {}
    for name, material in mesh.materials.items():
        for region in ("all",) if isinstance(material.regions, str) else material.regions:
            if (other := claimed.setdefault(region, name)) != name:
                yield Problem(
                    f"mesh.materials.{name}.regions", f"region {region} is of material {other} too", "keep one"
                )
        yield from material_problems(f"mesh.materials.{name}", material)
    if len(mesh.materials) > 1 and "all" in claimed:
        yield Problem(f"mesh.materials.{claimed['all']}.regions", "'all' beside other materials", "name the regions")


def _section(key: str, own: ElementSection) -> Iterator[Problem]:
    """The section of shells, or that of beams or rods."""
    yield from exactly_one(key, {"thickness": own.thickness, "area": own.area})
    of_beams = {
        "second_moments": own.second_moments,
        "torsion": own.torsion,
        "direction": own.direction,
        "size": own.size,
    }
    if own.area is None:
        for name in (name for name, value in of_beams.items() if value is not None):
            yield Problem(f"{key}.{name}", "is of beams, which have an area", "remove the key", at_key=True)
    elif own.offset:
        yield Problem(f"{key}.offset", "is of shells, which have a thickness", "remove the key", at_key=True)
    elif own.second_moments is None:
        for name in (name for name in ("direction", "size") if of_beams[name] is not None):
            what = "is of beams, which have second_moments; this is a rod"
            yield Problem(f"{key}.{name}", what, "give second_moments, or remove the key", at_key=True)
    else:
        yy, zz, yz = (*own.second_moments, 0.0)[:3]
        if yz**2 >= yy * zz:
            what = f"∫yz dA of {yz:g} m⁴ is too large for ∫y² dA and ∫z² dA, {yy:g} and {zz:g} m⁴"
            yield Problem(f"{key}.second_moments", what, "its square is below their product in every section")
        for name, remedy in (("torsion", "give J [m⁴]"), ("direction", "give a vector such as [0, 0, 1]")):
            if of_beams[name] is None:
                yield Problem(f"{key}.{name}", "missing: beams need it beside second_moments", remedy, at_key=True)
    if own.direction is not None and not any(own.direction):
        yield Problem(f"{key}.direction", NO_LENGTH, FOR_EXAMPLE)


def _free(config: PlacementConfig) -> Iterator[Problem]:
    """What a structure without supports cannot have: where it is depends on its whole past, and on nothing that is modelled."""
    if not config.mesh.free:
        return
    soft = "use gauges, or hold it on soft springs (mesh.supports, stiffness) without mesh.free"
    for name, sensors in config.motion_sensors.items():
        what = "reads the rigid motion, which is left out of a free structure (mesh.free)"
        yield Problem(f"motion_sensors.{name}", f"{sensors.quantity} {what}", soft, at_key=True)


def _springs(key: str, support: Support, mesh: MeshFile) -> Iterator[Problem]:
    """Springs of a support."""
    given = support.stiffness
    if given is None:
        return
    values = given if isinstance(given, tuple) else (given,)
    if min(values) < 0 or max(values) == 0:
        yield Problem(f"{key}.stiffness", "no positive stiffness", "give one in N/m; without `stiffness` it is held")
    if isinstance(given, tuple) and support.components != (1, 2, 3):
        yield Problem(
            f"{key}.components", "three stiffnesses are those along x, y and z", "remove the key", at_key=True
        )
    turned = {component > 3 for component in support.components}
    if len(turned) > 1:
        yield Problem(f"{key}.components", "one stiffness for [N/m] and [N m/rad]", "make two supports of it")
    if True in turned and support.set in mesh.faces:
        yield Problem(f"{key}.components", "a face has no rotations", "give the stiffness of translations, or a node")
    if mesh.matrices is not None:
        yield Problem(f"{key}.stiffness", "the stiffness is that of mesh.matrices", "put the spring there", at_key=True)


def load_problems(key: str, load: Load) -> Iterator[Problem]:
    places = {"node": load.node, "set": load.set, "deck_load": load.deck_load}
    of_mass = {"gravity": load.gravity, "rotation": load.rotation}
    if any(of_mass.values()):
        yield from _on_all_mass(key, load, of_mass, places)
        yield from _signal(key, load)
        return
    yield from exactly_one(key, places)
    if load.factor and load.deck_load is None:
        yield Problem(f"{key}.factor", "is of a load of the deck", "remove the key, or name a deck_load", at_key=True)
    kinds = {"moment": load.moment, "bearing": load.bearing, "pressure": load.pressure}
    if given := [name for name, value in kinds.items() if value is not None]:
        yield from _instead(key, load, given, kinds[given[0]])
    elif load.direction is None and load.deck_load is None:
        yield Problem(f"{key}.direction", "missing", "give a vector such as [0, 0, 1]", at_key=True)
    elif load.direction is not None and load.deck_load is not None:
        yield Problem(f"{key}.direction", "a load of the deck has its own direction", "remove the key", at_key=True)
    elif load.direction is not None and not any(load.direction):
        yield Problem(f"{key}.direction", "a direction of length zero", "give a vector such as [0, 0, 1]")
    yield from _signal(key, load)


def _on_all_mass(key: str, load: Load, of_mass: Mapping[str, object], places: Iterable[str]) -> Iterator[Problem]:
    """Gravity or a rotation, which acts everywhere."""
    kind, *others = [name for name, value in of_mass.items() if value is not None]
    rest = (*places, "direction", "moment", "bearing", "pressure", "factor")
    for name in (*others, *(name for name in rest if getattr(load, name) is not None)):
        yield Problem(f"{key}.{name}", f"a load with '{kind}', too", "remove one of the two keys", at_key=True)
    vector = load.gravity if load.rotation is None else load.rotation.axis
    if vector is not None and not any(vector):
        where = f"{key}.gravity" if load.rotation is None else f"{key}.rotation.axis"
        yield Problem(where, "a vector of length zero", "give a vector such as [0, 0, -1]")


def _signal(key: str, load: Load) -> Iterator[Problem]:
    yield from signal_problems(f"{key}.signal", load.signal)
    if not load.known and isinstance(load.signal, Recorded) and load.process_noise.frequency is None:
        yield Problem(
            f"{key}.process_noise",
            "an unknown load from a recorded signal needs a typical frequency",
            f"give {key}.process_noise.frequency [Hz]",
            at_key=True,
        )


def _instead(key: str, load: Load, given: Sequence[str], value: object) -> Iterator[Problem]:
    """What stands instead of a direction."""
    kind = given[0]
    if len(given) > 1:
        yield Problem(f"{key}.{given[1]}", f"a load with '{kind}', too", "remove one of the two keys", at_key=True)
    if load.deck_load is not None:
        what = "a load of the deck is no moment" if kind == "moment" else "a load of the deck has its own forces"
        yield Problem(f"{key}.{kind}", what, "remove the key", at_key=True)
    elif load.direction is not None:
        own = {"moment": "a moment has an axis", "bearing": "a bearing load has a vector of its own"}
        what = f"{own.get(kind, 'a pressure acts inward')} and no direction"
        yield Problem(f"{key}.direction", what, "remove one of the two keys", at_key=True)
    if isinstance(value, tuple) and not any(value):
        yield Problem(f"{key}.{kind}", "an axis of length zero", "give a vector such as [0, 0, 1]")
    if kind != "moment" and load.set is None:
        yield Problem(f"{key}.{kind}", "acts on a face", "give `set` the name of one of mesh.faces", at_key=True)
