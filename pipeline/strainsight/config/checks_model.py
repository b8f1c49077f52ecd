"""Consistency checks between fields of a config: mesh, parameters, loads, candidates, bonded gauges, layout limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from strainsight.config.base import Problem, known
from strainsight.config.gauge_types import type_problems
from strainsight.config.gauges import AbsoluteNoise, BondedBridge
from strainsight.config.imported import ResponseOfLoad, ResultsSection
from strainsight.config.parameters import GuessFrom, RayleighDamping
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of

DAMPING = "damping_factor"
OF_STEP = "set `magnitude` to the load that caused this response in the results file, such as 500 for 500 N"


def matrix_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check that imported matrices depend on exactly the parameters of the config."""
    matrices = config.mesh.matrices
    if matrices is not None and config.mesh.free:
        what = "cannot be combined with mesh.matrices, since a free structure needs matrices assembled from the mesh"
        yield Problem("mesh.free", what, "remove mesh.free or mesh.matrices")
    if matrices is not None and config.mesh.mass is not None:
        what = "mesh.matrices already contains the mass matrix"
        yield Problem("mesh.mass", what, "remove mesh.mass or mesh.matrices")
    if config.mesh.point_masses and (matrices is not None or config.mesh.results is not None):
        what = f"{'mesh.matrices' if matrices is not None else 'mesh.results'} already contains all masses"
        remedy = "remove mesh.point_masses, and include the masses in the imported model"
        yield Problem("mesh.point_masses", what, remedy, at_key=True)
    for name, load in config.loads.items():
        if matrices is not None and (load.gravity or load.rotation):
            what = "gravity and rotation need the positions of the masses, but mesh.matrices contains no positions"
            remedy = "define the forces as a load of the deck, and replace `gravity` or `rotation` by `deck_load: NAME`"
            yield Problem(f"loads.{name}", what, remedy, at_key=True)
    if matrices is None:
        return
    named: set[str] = set()
    for kind, terms in (("stiffness", matrices.stiffness), ("mass", matrices.mass)):
        for i, term in enumerate(terms):
            key = f"mesh.matrices.{kind}.{i}"
            if term.parameter is None:
                if term.at is not None:
                    yield Problem(f"{key}.at", "`at` is set without `parameter`", "set `parameter`, or remove `at`")
                continue
            named.add(term.parameter)
            wanted = {"stiffness": ("youngs_modulus", "stiffness_factor"), "mass": ("density",)}[kind]
            yield from known(f"{key}.parameter", term.parameter, config.parameters, "parameter")
            parameter = config.parameters.get(term.parameter)
            if parameter is not None and parameter.property not in wanted:
                what = (
                    f"the {kind} matrix is not proportional to {parameter.property}, the property of '{term.parameter}'"
                )
                remedy = f"set `parameter` to a parameter with the property {' or '.join(wanted)}"
                yield Problem(f"{key}.parameter", what, remedy)
    for name in config.parameters:
        if name not in named and named <= set(config.parameters) and config.parameters[name].property != DAMPING:
            what = "no term of mesh.matrices depends on this parameter"
            remedy = f"set `parameter: {name}` for one term of mesh.matrices, or remove the parameter"
            yield Problem(f"parameters.{name}", what, remedy, at_key=True)


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
        what = "cannot be combined with mesh.results: the imported modes already contain stiffness, mass and supports"
        yield Problem(key, what, f"remove {key} or mesh.results", at_key=True)
    for i, support in enumerate(config.mesh.supports):
        if support.stiffness is not None:
            what = "mesh.results already contains the stiffness of all springs"
            remedy = "remove `stiffness`, and include the spring in the model that produced mesh.results"
            yield Problem(f"mesh.supports.{i}.stiffness", what, remedy, at_key=True)
    yield from _responses("mesh.results.loads", results.loads, config)
    for name in results.at:
        yield from known(f"mesh.results.at.{name}", name, config.parameters, "parameter", at_key=True)
    yield from _second_results(config, results)
    for kind, properties in (("stiffness", ("youngs_modulus", "stiffness_factor")), ("mass", ("density",))):
        scaling = [name for name, entry in config.parameters.items() if entry.property in properties]
        for name in scaling[1:]:
            what = f"only one parameter may scale the {kind} of mesh.results, and parameter '{scaling[0]}' already does"
            yield Problem(f"parameters.{name}", what, f"remove the parameter {name} or {scaling[0]}", at_key=True)
    for name, own_parameter in config.parameters.items():
        if own_parameter.property not in ("youngs_modulus", "stiffness_factor", "density", DAMPING):
            what = f"mesh.results does not contain the effect of the property {own_parameter.property}"
            remedy = "set property: stiffness_factor without `region`, or remove mesh.results"
            yield Problem(f"parameters.{name}.property", what, remedy)
        if own_parameter.springs is not None:
            what = "mesh.results does not contain the stiffness of single springs"
            remedy = "replace mesh.results by mesh.matrices, with a separate stiffness term for the springs"
            yield Problem(f"parameters.{name}.springs", what, remedy, at_key=True)


def _second_results(config: PlacementConfig, results: ResultsSection) -> Iterator[Problem]:
    """Check that a second set has a stiffness or density of some regions as parameter, and the loads of the first set."""
    second, key = results.second, "mesh.results.second"
    if second is None:
        return
    parameter = config.parameters.get(second.parameter)
    if parameter is None:
        yield from known(f"{key}.parameter", second.parameter, config.parameters, "parameter")
    elif parameter.property not in ("youngs_modulus", "stiffness_factor", "density") or parameter.region is None:
        kind = f"has the property {parameter.property}" if parameter.region is not None else "applies to all regions"
        what = f"mesh.results.second has no effect, since parameter '{second.parameter}' {kind}"
        remedy = (
            "set `parameter` to a parameter with `region` and the property youngs_modulus, stiffness_factor or density"
        )
        yield Problem(f"{key}.parameter", what, remedy)
    if second.loads is None:
        for name, load in results.loads.items():
            if load.file is not None:
                what = f"missing, but mesh.results.loads.{name}.file is a separate file for the response to load {name}"
                remedy = "list every load in mesh.results.second.loads, with the results at the second parameter value as `file`"
                yield Problem(f"{key}.loads", what, remedy, at_key=True)
        return
    yield from _responses(f"{key}.loads", second.loads, config)


def _responses(key: str, loads: Mapping[str, ResponseOfLoad], config: PlacementConfig) -> Iterator[Problem]:
    """Check the names and magnitudes of the loads of imported responses, which are below this key."""
    for name, load in loads.items():
        yield from known(f"{key}.{name}", name, config.loads, "load", at_key=True)
        if load.magnitude == 0:
            yield Problem(f"{key}.{name}.magnitude", "the load magnitude is zero", OF_STEP)


MODULI = ("youngs_modulus", "e1", "e2", "g12", "g1z", "g2z")
RESERVED = {"constant", "factors", "roots", "weights"}  # other datasets of an affine operator


def model_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Yield the inconsistencies between the fields that define the model."""
    yield from _names(config)
    yield from _free(config)
    yield from _places(config)
    yield from matrix_problems(config)
    for name, parameter in config.parameters.items():
        if isinstance(parameter.guess, GuessFrom) and parameter.guess.source == config.name:
            what = "a run cannot use its own estimate as guess"
            yield Problem(f"parameters.{name}.guess.from", what, "set `from` to another run, or `guess` to a number")


def static_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check for parameters and sensors that need inertia, with train.model: static."""
    if config.train.model != "static":
        return
    for name, parameter in config.parameters.items():
        if parameter.property == "density" and not any(load.gravity or load.rotation for load in config.loads.values()):
            what = "without gravity or rotation, a static model (train.model: static) does not depend on the density"
            yield Problem(f"parameters.{name}.property", what, "set train.model: dynamic, or add a gravity load")
    for name, sensors in config.motion_sensors.items():
        if sensors.quantity == "acceleration":
            what = "a static model (train.model: static) has no accelerations"
            yield Problem(
                f"motion_sensors.{name}.quantity", what, f"set train.model: dynamic, or remove motion_sensors.{name}"
            )


def _names(config: PlacementConfig) -> Iterator[Problem]:
    for name in config.parameters:
        if name in config.loads:
            what = "a parameter has the same name"
            yield Problem(f"loads.{name}", what, "rename the load or the parameter", at_key=True)
    for section, names in (("parameters", config.parameters), ("loads", config.loads)):
        for name in names:
            if name in RESERVED:
                what = f"the name '{name}' is reserved for a dataset of the result files"
                yield Problem(f"{section}.{name}", what, f"rename this entry of {section}", at_key=True)


def _places(config: PlacementConfig) -> Iterator[Problem]:
    """Check that a parameter has regions, springs or matrix terms, and a ply modulus a material."""
    matrices = config.mesh.matrices
    for name, parameter in config.parameters.items():
        key = f"parameters.{name}"
        if parameter.material is not None and parameter.property not in MODULI:
            what = f"a ply material does not have the property {parameter.property}"
            remedy = f"remove `material`, or set `property` to one of {', '.join(MODULI)}"
            yield Problem(f"{key}.material", what, remedy)
        if parameter.springs is not None:
            if matrices is not None:
                remedy = "remove `springs`, and define a separate stiffness term of the springs in mesh.matrices"
                yield Problem(f"{key}.springs", "the springs are part of mesh.matrices", remedy)
            elif parameter.region is not None:
                remedy = "remove `springs` or `region`, or define two parameters"
                yield Problem(f"{key}.springs", "`springs` and `region` are both set", remedy)
            if parameter.property != "stiffness_factor":
                what = f"springs do not have the property {parameter.property}"
                remedy = "set property: stiffness_factor, a factor on the stiffness of the springs"
                yield Problem(f"{key}.property", what, remedy)
        elif parameter.property == DAMPING:
            continue
        elif parameter.region is None and matrices is None and config.mesh.results is None:
            remedy = "set `region` to an id, a name or a list of regions, or set `springs` to a list of spring names"
            yield Problem(f"{key}.region", "missing", remedy, at_key=True)
        elif parameter.region is not None and matrices is not None:
            what = "with mesh.matrices, a parameter applies to terms of the matrices, not to regions"
            yield Problem(f"parameters.{name}.region", what, "remove `region`")


def _free(config: PlacementConfig) -> Iterator[Problem]:
    """Check for sensors and loads that a free structure cannot have, since its position depends on the whole past."""
    if not config.mesh.free:
        return
    soft = "remove these sensors, or replace mesh.free by soft springs (`stiffness` in mesh.supports)"
    for name, sensors in config.motion_sensors.items():
        what = "sensors measure the rigid-body motion, but the model of a free structure (mesh.free) omits this motion"
        yield Problem(f"motion_sensors.{name}", f"{sensors.quantity} {what}", soft, at_key=True)


def damping_problems(config: PlacementConfig) -> Iterator[Problem]:
    """Check the parameters with property damping_factor."""
    names = [name for name, parameter in config.parameters.items() if parameter.property == DAMPING]
    for name in names[1:]:
        what = f"parameter '{names[0]}' already has the property {DAMPING}, which only one parameter may have"
        yield Problem(f"parameters.{name}", what, f"remove the parameter {name} or {names[0]}", at_key=True)
    for name in names:
        parameter = config.parameters[name]
        if parameter.region is not None:
            what = f"a parameter with the property {DAMPING} scales the damping of every mode, not of a region"
            yield Problem(f"parameters.{name}.region", what, "remove `region`")
        law = config.damping
        none = not (law.alpha or law.beta) if isinstance(law, RayleighDamping) else not law.ratio
        if none:
            what = f"the property {DAMPING} has no effect, since the damping in the key `damping` is zero"
            remedy = "set `damping` to the expected value, such as {type: modal, ratio: 0.01}"
            yield Problem(f"parameters.{name}.property", what, remedy)
        spread = tolerances_of(config.tolerances).damping
        if name in config.place.estimate and spread > 1:
            what = (
                f"the property {DAMPING} is one factor for all modes, but tolerances.damping permits a separate factor of "
                f"{spread:g} for each mode"
            )
            remedy = f"set tolerances.damping: 1, or remove {name} from place.estimate"
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
        what = f"a noise of {value:g} m/m is {100 * value:g} % strain, more than {100 * LARGEST_NOISE:g} %"
        yield Problem("gauges.noise_std.value", what, f"set the noise in m/m: {value:g} um/m is {1e-6 * value:.1e} m/m")
    grids = 0 if gauges.direction is None or not gauges.rosette else len(gauges.direction.angles)
    if grids == 1:
        what = "a rosette needs two or three measuring grids, but gauges.direction.angles has one angle"
        remedy = "set gauges.direction.angles, such as [0, 45, 90], or remove gauges.rosette"
        yield Problem("gauges.rosette", what, remedy)
    if grids > LARGEST_ROSETTE:
        what = f"a rosette with {grids} measuring grids is not supported"
        yield Problem("gauges.direction.angles", what, "use at most three angles, or remove gauges.rosette")
    if gauges.direction is not None:
        yield from type_problems(gauges, len(gauges.direction.angles) if gauges.rosette else 1)
    for name, sensors in config.motion_sensors.items():
        directions = [axis if axis == "normal" else _unit(axis) for axis in sensors.axes]
        if any(a in directions[:i] for i, a in enumerate(directions)):
            yield Problem(f"motion_sensors.{name}.axes", "two axes are parallel", "remove one of the parallel axes")
    yield from _mirrored(config)
    yield from _bridges(config)
    yield from _count(config)


def _strain_rows(config: PlacementConfig) -> Iterator[Problem]:
    """Check for keys that need a mesh surface, if candidates are rows of the strain operator."""
    gauges = config.gauges
    if gauges.strain_operator is None:
        if gauges.direction is None:
            remedy = "set gauges.direction: {type: axis, axis: [1, 0, 0]}, or set gauges.strain_operator"
            yield Problem("gauges.direction", "missing", remedy, at_key=True)
        return
    if config.mesh.matrices is None:
        what = "the strain operator uses the degrees of freedom of mesh.matrices, but mesh.matrices is missing"
        yield Problem(
            "gauges.strain_operator", what, "set mesh.matrices, or remove gauges.strain_operator", at_key=True
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
            }.get(key, "this key needs candidates on a surface of the mesh")
            yield Problem(key, f"cannot be combined with gauges.strain_operator: {what}", f"remove {key}", at_key=True)


def _bridges(config: PlacementConfig) -> Iterator[Problem]:
    """Check candidates that are bridges: a bridge is one channel, and has no mirror image."""
    if config.gauges.bridge is None:
        return
    if config.gauges.rosette:
        what = "a rosette cannot be an arm of a bridge"
        yield Problem("gauges.rosette", what, "remove gauges.rosette or gauges.bridge", at_key=True)
    if config.place.symmetry is not None:
        what = "candidates with bridges cannot be placed in mirrored pairs"
        remedy = "remove place.symmetry or gauges.bridge; bridges in gauges.fixed are permitted"
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
        listed = ", ".join(f"{0.0 - angle:g}" for angle in direction.angles)
        what = f"place.symmetry needs the angles and their mirror images ({listed} deg) in this list"
        remedy = "add the mirror images, or use angles such as [0, 60, 120], [0, 90] or [-45, 0, 45]"
        yield Problem("gauges.direction.angles", what, remedy)


def _count(config: PlacementConfig) -> Iterator[Problem]:
    keep, names = config.place.keep, tuple(dict.fromkeys(config.place.estimate))
    direction, rosette = config.gauges.direction, config.gauges.rosette
    # signals of one gauge: of a rosette, or of a triaxial accelerometer
    counts = [len(direction.angles) if direction is not None and rosette else 1]
    counts += [len(sensors.axes) for sensors in config.motion_sensors.values()]
    counts += [len(bonded.angles) for bonded in config.gauges.fixed if not isinstance(bonded, BondedBridge)]
    counts += [LARGEST_ROSETTE] * (config.gauges.fixed_file is not None)  # nobody has read it yet
    signals = keep * max(counts)
    if signals < len(names):
        yield Problem(
            "place.keep",
            f"{keep} gauge{'s' * (keep != 1)} cannot observe {len(names)} unknowns ({', '.join(names)})",
            f"set place.keep to at least {-(-len(names) * keep // signals)}, or remove unknowns from place.estimate",
        )
    pool = config.screen.keep
    if pool != "all" and keep > pool:
        what = f"place.keep is {keep}, but screen.keep limits the candidates to {pool}"
        yield Problem("place.keep", what, f"set place.keep to at most {pool}, or increase screen.keep")
