"""What one field of a config demands of another: mesh, parameters, loads."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from strainsight.config.checks_damping import DAMPING, damping_problems
from strainsight.config.checks_elsewhere import matrix_problems, result_problems
from strainsight.config.checks_material import material_problems, plane_problems
from strainsight.config.loads import Load, Recorded, signal_problems
from strainsight.config.mesh import ElementSection, MeshFile, Support
from strainsight.config.placement import GuessFrom, MaterialParameter, PlacementConfig
from strainsight.config.problem import Problem, exactly_one
from strainsight.config.zones import FOR_EXAMPLE, NO_LENGTH, box_problem

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
