"""Translate config sections to model terms, and check at `import` that all references exist in the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.config.gauges import Gauges, MotionSensors
from strainsight.config.imported import Matrices
from strainsight.config.loads import InputNoise, LoadSection
from strainsight.config.mesh import MeshFile
from strainsight.config.parameters import GuessFrom, MaterialParameter
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ArtefactError, ConfigError, InfeasibleError, UserError, blame
from strainsight.experiment.layout.gauge_list import sites_of
from strainsight.experiment.recorded import named_regions
from strainsight.fem.affine import DAMPING, Parameter
from strainsight.fem.by_region import regions_of
from strainsight.fem.loads import PointLoad, input_shape, loaded_nodes, nodal_forces
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.springs import spring_owners
from strainsight.loads.histories import MultiSine, Signal, Sine, Sweep, evaluate
from strainsight.loads.input_models import InputModel, Unknowns, input_model
from strainsight.mesh.additions import region_ids, spring_names
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import NodalForces
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import OF_MASS, PLY_MODULI, SECTION_FACTORS, THICKNESS, value_of, with_value
from strainsight.mesh.sanity import attached
from strainsight.mesh.thin import BeamBlock, ShellBlock
from strainsight.mesh.thin_faces import NO_SIDES, WITH_SIDES, lines_without_sides
from strainsight.runner.artefact import Artefact
from strainsight.sensors.zones import admissible

PARAMETER_UNITS = {
    "youngs_modulus": "Pa",
    "density": "kg/m^3",
    "stiffness_factor": "1",
    DAMPING: "1",
    **dict.fromkeys(PLY_MODULI, "Pa"),
    **dict.fromkeys(SECTION_FACTORS, "1"),
    THICKNESS: "m",
}


def parameters_of(
    config: Mapping[str, MaterialParameter], mesh: Mesh, files: Mapping[str, Path], section: MeshFile | None = None
) -> tuple[Parameter, ...]:
    """Parameters of the config with their regions or springs and reference value [SI].

    section: the config's `mesh`; with imported matrices parameters have no regions, with imported results they cover all regions.
    Raises ConfigError for an unknown region or spring, a guess far from the value of the file, and a guess not available in the
    other run."""
    parameters = []
    for name, entry in config.items():
        value, (low, high) = reference_value(name, entry.guess, files), entry.range
        if not low <= value <= high:
            raise ConfigError(
                f"the guess of {name}, {value:.6g}, is outside its range {low:g} to {high:g}",
                key=f"parameters.{name}.range",
                remedy="Widen the range, or change the guess.",
            )
        if entry.property == DAMPING:
            continue
        if section is not None and section.matrices is not None:
            _check_against_terms(name, value, section.matrices)
            parameters.append(Parameter(name, entry.property, (), value, range=entry.range))
            continue
        regions, springs = places_of(name, entry, mesh, section)
        of_deck: dict[str, float] = {}
        if section is not None and section.results is not None and name in section.results.at:
            of_deck["the results"] = section.results.at[name]
        for region in regions if not of_deck else ():
            if section is not None and section.results is not None and mesh.density_of(region) is None:
                continue
            with blame(f"parameters.{name}.{'property' if entry.material is None else 'material'}"):
                of_deck[f"region {region}"] = value_of(mesh, region, entry.property, entry.material)
        for place, deck in {**of_deck, **dict.fromkeys(springs, 1.0)}.items():
            if not 0.1 <= value / deck <= 10:
                unit = PARAMETER_UNITS[entry.property]
                factor, usual = {"Pa": (1e6, "MPa"), "m": (1e-3, "mm")}.get(unit, (1.0, unit))
                remedy = "Check mesh.length_unit and mesh.mass_unit, or the guess."
                if unit == "1":
                    remedy = "Set a factor on the value of the deck; 1.0 leaves the value unchanged."
                elif 0.1 <= factor * value / deck <= 10:
                    remedy = f"If you mean {value:g} {usual}, set {factor * value:.4g} {unit}."
                raise ConfigError(
                    f"the guess of {name} is {value:.4g}, but the value of the deck is {deck:.4g} in {place} (SI units)",
                    key=f"parameters.{name}.guess",
                    remedy=remedy,
                )
        if entry.property == THICKNESS:
            _require_equal_thickness(name, of_deck)
        parameters.append(Parameter(name, entry.property, regions, value, springs, entry.range, entry.material))
    return tuple(parameters)


def damping_parameter(config: Mapping[str, MaterialParameter], files: Mapping[str, Path]) -> tuple[str, float] | None:
    """Name and reference value [-] of the damping factor, None if it is not estimated."""
    for name, entry in config.items():
        if entry.property == DAMPING:
            return name, reference_value(name, entry.guess, files)
    return None


def _require_equal_thickness(name: str, of_deck: Mapping[str, float]) -> None:
    """Raises ConfigError for regions of different thicknesses [m], which one parameter cannot represent."""
    if max(of_deck.values()) > (1 + 1e-6) * min(of_deck.values()):
        raise ConfigError(
            "the regions of one thickness parameter have different thicknesses: "
            + ", ".join(f"{place} {1e3 * value:.4g} mm" for place, value in of_deck.items()),
            key=f"parameters.{name}.region",
            remedy="Use a separate parameter for each thickness.",
        )


def places_of(
    name: str, entry: MaterialParameter, mesh: Mesh, section: MeshFile | None = None
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Region ids and spring names of a parameter; with imported results all regions by default. Raises UserError for unknown
    ones."""
    if section is not None and section.results is not None and entry.region is None:
        return tuple(regions_of(mesh.elements)), ()
    with blame(f"parameters.{name}.region"):
        regions = region_ids(mesh, named_regions(entry.region))
    with blame(f"parameters.{name}.springs"):
        return regions, spring_names(mesh, entry.springs or ())


def _check_against_terms(name: str, value: float, matrices: Matrices) -> None:
    terms = [
        (f"mesh.matrices.{kind}.{i}", term)
        for kind, entries in (("stiffness", matrices.stiffness), ("mass", matrices.mass))
        for i, term in enumerate(entries)
        if term.parameter == name
    ]
    for key, term in terms:
        if term.at is not None and not 0.1 <= value / term.at <= 10:
            raise ConfigError(
                f"the guess of {name} is {value:.4g}, but the matrix {key} was computed with {term.at:.4g} (SI units)",
                key=f"{key}.at",
                remedy="Check that both values are in SI units.",
            )


def reference_value(name: str, guess: float | GuessFrom, files: Mapping[str, Path]) -> float:
    """Guess [SI]: a number, or the estimate of the same parameter in another run (thesis 6.1.3)."""
    if not isinstance(guess, GuessFrom):
        return float(guess)
    key = f"parameters.{name}.guess.from"
    with blame(key):
        summary = Artefact(files[key]).summary
    if f"estimate.{name}" not in summary:
        raise ArtefactError(
            f"{files[key].name} of run '{files[key].parent.name}' has no estimate of parameter '{name}'",
            key=key,
            remedy="Choose a run with this parameter in place.estimate.",
        )
    return float(summary[f"estimate.{name}"])


def unknown_units(config: PlacementConfig) -> dict[str, str]:
    """Unit of every unknown, by name."""
    parameters = config.parameters
    return {
        name: config.loads[name].unit if name in config.loads else PARAMETER_UNITS[parameters[name].property]
        for name in config.place.estimate
    }


def load_units(loads: Mapping[str, LoadSection]) -> str:
    """Unit, or units, of an array over these loads."""
    return " or ".join(sorted({load.unit for load in loads.values()}))


def load_shapes(model: FiniteElementModel, config: Mapping[str, LoadSection]) -> np.ndarray:
    """Input shape S (n_free, n_u) [-] of every load, in the order of the config."""
    columns = []
    for name, load in point_loads(config).items():
        with blame(f"loads.{name}"):
            columns.append(input_shape(model, (load,)))
    return np.hstack(columns)


def load_slopes(
    model: FiniteElementModel, config: Mapping[str, LoadSection], parameters: Sequence[Parameter]
) -> dict[str, np.ndarray]:
    """Slopes ∂S/∂θᵢ (n_free, n_u) [1 per unit of θ] of body forces with respect to density, thickness and section factors.

    S is affine in these, so that the difference is exact, except to 5e-4 for moments of unsymmetric laminates. Raises UserError
    if density and section of one region are both estimated, as S depends on their product."""
    on_mass = [i for i, load in enumerate(point_loads(config).values()) if load.of_mass]
    slopes = {}
    for parameter in parameters if on_mass else ():
        if parameter.property in OF_MASS:
            _require_affine(parameter, parameters)
            step = 1e-3 if parameter.property == THICKNESS else 1.0
            # a factor refers to the mesh of the model
            value = (1 + step) * (parameter.reference if parameter.property in ("density", THICKNESS) else 1.0)
            more = replace(model, mesh=with_value(model.mesh, parameter.property, parameter.regions, value))
            names = [list(config)[i] for i in on_mass]
            change = [load_shapes(each, {name: config[name] for name in names}) for each in (more, model)]
            slope = np.zeros((model.size, len(config)))
            slope[:, on_mass] = (change[0] - change[1]) / (step * parameter.reference)
            slopes[parameter.name] = slope
    return slopes


def _require_affine(parameter: Parameter, parameters: Sequence[Parameter]) -> None:
    """Raises UserError if density and thickness or section factor of one region are both estimated."""
    for other in parameters:
        both = {parameter.property, other.property} & {"density"}
        if (
            both
            and other.property in OF_MASS
            and parameter.property != other.property
            and set(parameter.regions) & {*other.regions}
        ):
            raise UserError(
                f"body forces (gravity, rotation) depend on the product of {parameter.name} and {other.name}",
                key=f"parameters.{other.name}",
                remedy="Remove one of these parameters from place.estimate, or use nodal forces (loads.*.node).",
            )


def point_loads(config: Mapping[str, LoadSection]) -> dict[str, PointLoad]:
    """Loads of the config in its order."""
    common = ("direction", "deck_load", "moment", "bearing", "gravity")
    return {
        name: PointLoad(
            name,
            node_id=entry.node,
            node_set=entry.set,
            pressure=bool(entry.pressure),
            factor=bool(entry.factor),
            rotation=None if entry.rotation is None else (entry.rotation.axis, entry.rotation.point),
            **{key: getattr(entry, key) for key in common},
        )
        for name, entry in config.items()
    }


def families(config: PlacementConfig) -> dict[str, Gauges | MotionSensors]:
    """Config key → sensors in the order of `Candidates.array`: strain gauges, then motion sensors sorted by name."""
    others = {f"motion_sensors.{name}": config.motion_sensors[name] for name in sorted(config.motion_sensors)}
    return {"gauges": config.gauges, **others}


def characteristic(entry: LoadSection, signal: Signal, duration: float) -> tuple[float, float]:
    """Frequency [Hz] and amplitude for the process noise of an unknown load (5.16), configured or from its signal."""
    noise = entry.process_noise
    match signal:
        case Sine():
            typical = (signal.frequency, signal.amplitude)
        case Sweep():
            typical = (max(signal.start, signal.stop), signal.amplitude)
        case MultiSine():
            typical = (signal.highest, signal.amplitude)
        case _:
            t = np.linspace(0, duration, 2001)
            typical = (float("nan"), float(np.abs(evaluate(signal, t)).max()))
    frequency = noise.frequency if noise.frequency is not None else typical[0]
    return float(frequency), float(noise.amplitude if noise.amplitude is not None else typical[1])


def unknowns_of(
    estimate: Sequence[str],
    loads: Mapping[str, LoadSection],
    typical: Mapping[str, tuple[float, float]],
    reference: Mapping[str, float],
) -> Unknowns:
    """Loads and parameters to estimate with their scales (amplitude, guess); typical: frequency [Hz] and amplitude of every
    load."""
    inputs = tuple(name for name in estimate if name in loads)
    return Unknowns(
        inputs=inputs,
        parameters=tuple(name for name in estimate if name not in loads),
        amplitude={name: amplitude for name, (_, amplitude) in typical.items()},
        guess={name: reference[name] for name in estimate if name not in loads},
        models={name: _input_model(loads[name].process_noise, typical[name][0]) for name in inputs},
        frequency={name: frequency for name, (frequency, _) in typical.items()},
    )


def _input_model(noise: InputNoise, frequency: float) -> InputModel:
    return input_model(noise.model, frequency, noise.kappa, noise.smoothness, noise.damping)


def check_references(config: PlacementConfig, mesh: Mesh) -> None:
    """Check nodes, sets, faces and deck loads; regions, springs and guesses of parameters; surfaces and zones of sensors.

    Raises UserError with the key of an invalid reference, and for a load that would change with a parameter."""
    if config.mesh.matrices is None:
        known = {
            name: parameter_entry
            for name, parameter_entry in config.parameters.items()
            if not isinstance(parameter_entry.guess, GuessFrom)
        }
        parameters_of(known, mesh, {}, config.mesh)
        for name, parameter in config.parameters.items():
            if parameter.property != DAMPING:
                places_of(name, parameter, mesh, config.mesh)
        with blame("parameters"):
            spring_owners(
                mesh, {name: parameter_entry.springs or () for name, parameter_entry in config.parameters.items()}
            )
    for name, load in point_loads(config.loads).items():
        with blame(f"loads.{name}"):
            if load.moment is None:
                forces = nodal_forces(mesh, load)
                assembled = config.mesh.matrices is None and config.mesh.results is None
                if assembled and len(forces.nodes) and not (connected := attached(mesh)[forces.nodes]).any():
                    node = mesh.node_ids[forces.nodes[np.flatnonzero(~connected)[0]]]
                    raise UserError(
                        f"the load acts on node {node}, which is not connected to any element, tie, spring or support",
                        remedy="Apply the load to a node of the structure, or tie this node to it (RBE2, RBE3, mesh.ties).",
                    )
                if not load.of_mass:
                    _check_mass(config, mesh, forces)
            else:
                loaded_nodes(mesh, load)
    if not mesh.has_surface or config.gauges.strain_operator is not None:
        return
    facets = exterior_facets(mesh)
    for key, sensors in families(config).items():
        # an empty surface is reported by `train`
        with suppress(InfeasibleError):
            admissible(mesh, facets, **sites_of(sensors), key=key)


def without_surface(mesh: Mesh) -> ConfigError:
    """The error of a mesh without surface for gauges."""
    lines = lines_without_sides(mesh)
    return ConfigError(
        f"the mesh has no surface for gauges: {f'it consists of {lines}, and {NO_SIDES}' if lines else 'it has no elements'}",
        key="gauges.surface",
        remedy=f"{WITH_SIDES}, or import matrices (mesh.matrices) and strain operators (gauges.strain_operator).",
    )


def _check_mass(config: PlacementConfig, mesh: Mesh, load: NodalForces) -> None:
    """Raises UserError for a body force of the deck that a parameter would change, as its nodal forces are fixed."""
    for name, parameter in config.parameters.items():
        if (
            load.regions
            and parameter.property in OF_MASS
            and set(region_ids(mesh, named_regions(parameter.region))) & {*load.regions}
        ):
            raise UserError(
                f"this body force of the deck would change with the parameter {name} ({parameter.property})",
                remedy="Define the load as `gravity` or `rotation` instead of `deck_load`, or remove the parameter.",
            )


def on_one_node(loads: Mapping[str, LoadSection], mesh: Mesh) -> tuple[str, ...]:
    """Warnings about concentrated forces on nodes of solids or shells (singular strain), except where a beam is attached."""
    solid, shell, beam = (_nodes(blocks) for blocks in (mesh.blocks, mesh.shells, mesh.beams))
    shell = np.setdiff1d(shell, beam)
    tied = {tie.reference for tie in mesh.rigid} | {tie.reference for tie in mesh.averaging}
    sentences = []
    for name, load in loads.items():
        if load.node is not None and load.moment is None:
            node = mesh.node_index(load.node)
            if node not in tied and (node in solid or node in shell):
                what = "solid" if node in solid else "shell"
                sentences.append(
                    f"loads.{name} is a concentrated force on node {load.node} of a {what}, where strain increases with mesh "
                    f"refinement. Distribute the force over a face (mesh.faces, loads.{name}.set), or tie the nodes to a "
                    "reference node (mesh.ties)"
                )
    return tuple(sentences)


def range_warnings(config: PlacementConfig, mesh: Mesh) -> tuple[str, ...]:
    """Warnings about parameters whose value in the deck is outside their range."""
    sentences = []
    known = {
        name: entry for name, entry in config.parameters.items() if entry.property != DAMPING and not entry.springs
    }
    for name, entry in known.items() if config.mesh.matrices is None and config.mesh.results is None else ():
        for region in places_of(name, entry, mesh, config.mesh)[0]:
            value, (low, high) = value_of(mesh, region, entry.property, entry.material), entry.range
            if not low <= value <= high:
                sentences.append(
                    f"{name} is {value:.4g} in {mesh.regions[region]} of the deck, outside parameters.{name}.range ({low:g} to "
                    f"{high:g}). Widen the range, or correct the deck, the region or the guess"
                )
                break
    return tuple(sentences)


def _nodes(blocks: Sequence[CellBlock | ShellBlock | BeamBlock]) -> np.ndarray:
    """Node indices of element blocks."""
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(block.nodes.ravel() for block in blocks)]))
