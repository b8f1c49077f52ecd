"""What a config refers to is in its mesh: asked at `import`, before anything that takes time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from strainsight.config.loads import Load
from strainsight.config.placement import GuessFrom, PlacementConfig
from strainsight.errors import InfeasibleError, UserError, blame
from strainsight.experiment.layout.gauge_list import zone_of
from strainsight.experiment.recorded import named_regions
from strainsight.experiment.structure.settings import (
    WHAT_IS_FREE,
    WHERE_LOADS_ACT,
    parameters_of,
    places_of,
    point_loads,
)
from strainsight.fem.affine import DAMPING
from strainsight.fem.loads import loaded_nodes, nodal_forces
from strainsight.fem.springs import spring_owners
from strainsight.mesh.additions import region_ids
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import NodalForces
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import OF_MASS, value_of
from strainsight.mesh.sanity import attached
from strainsight.mesh.thin import BeamBlock, ShellBlock
from strainsight.sensors.zones import admissible

READS = (
    *WHAT_IS_FREE,
    "parameters.*.guess",
    *WHERE_LOADS_ACT,
    "gauges.surface",
    "gauges.include",
    "gauges.exclude",
    "gauges.given",
    "motion_sensors.*.surface",
    "motion_sensors.*.include",
    "motion_sensors.*.exclude",
)


def check_references(config: PlacementConfig, mesh: Mesh) -> None:
    """Nodes, sets, faces and loads of the deck that loads act on; regions and springs of parameters, and guesses far from the
    deck's value; surfaces and zones of sensors.

    Raises UserError with the key of what is not there, and of a load that would change with a parameter.
    """
    if config.mesh.matrices is None:
        known = {name: own for name, own in config.parameters.items() if not isinstance(own.guess, GuessFrom)}
        parameters_of(known, mesh, {}, config.mesh)
        for name, parameter in config.parameters.items():
            if parameter.property != DAMPING:
                places_of(name, parameter, mesh, config.mesh)
        with blame("parameters"):
            spring_owners(mesh, {name: own.springs or () for name, own in config.parameters.items()})
    for name, load in point_loads(config.loads).items():
        with blame(f"loads.{name}"):
            if load.moment is None:
                forces = nodal_forces(mesh, load)
                assembled = config.mesh.matrices is None and config.mesh.results is None
                if assembled and len(forces.nodes) and not (held := attached(mesh)[forces.nodes]).any():
                    node = mesh.node_ids[forces.nodes[np.flatnonzero(~held)[0]]]
                    raise UserError(
                        f"it acts on node {node}, which belongs to no element, tie, spring or support",
                        remedy="load a node of the structure, or tie this one to it (RBE2, RBE3, mesh.ties)",
                    )
                if not load.of_mass:
                    _check_mass(config, mesh, forces)
            else:
                loaded_nodes(mesh, load)
    if not mesh.has_surface or config.gauges.given is not None:
        return
    facets = exterior_facets(mesh)
    sites = {"gauges": config.gauges} | {f"motion_sensors.{name}": own for name, own in config.motion_sensors.items()}
    for key, own in sites.items():
        include, exclude = ([zone_of(entry) for entry in zones] for zones in (own.include, own.exclude))
        with suppress(
            InfeasibleError
        ):  # what leaves no facet is named by `train`: an import is there to look at the faces
            admissible(mesh, facets, surface=own.surface, include=include, exclude=exclude, key=key)


def _check_mass(config: PlacementConfig, mesh: Mesh, load: NodalForces) -> None:
    """Raise UserError where a load of the deck is made by mass that a parameter changes: its forces have been summed up with that
    of the deck."""
    for name, parameter in config.parameters.items():
        if (
            load.regions
            and parameter.property in OF_MASS
            and set(region_ids(mesh, named_regions(parameter.region))) & {*load.regions}
        ):
            raise UserError(
                f"it is a load of the deck on mass, and would change with the {parameter.property} {name}, which is a parameter",
                remedy="state it as `gravity` or `rotation` in place of `deck_load`, or remove the parameter",
            )


def on_one_node(loads: Mapping[str, Load], mesh: Mesh) -> tuple[str, ...]:
    """A sentence for every force on one node of a solid or a shell: the strain beside it is that of a point, which gets larger
    with every finer mesh, and no gauge should be placed by it. What a beam brings to a node of shells is left to the deck."""
    solid, shell, beam = (_nodes(blocks) for blocks in (mesh.blocks, mesh.shells, mesh.beams))
    shell = np.setdiff1d(shell, beam)
    tied = {tie.reference for tie in mesh.rigid} | {tie.reference for tie in mesh.averaging}
    found = []
    for name, load in loads.items():
        if load.node is not None and load.moment is None:
            node = mesh.node_index(load.node)
            if node not in tied and (node in solid or node in shell):
                what = "solid" if node in solid else "shell"
                found.append(
                    f"loads.{name} acts on node {load.node} of a {what} alone: strain beside it grows with a finer mesh. Spread "
                    f"the force over a face (mesh.faces, loads.{name}.set), or tie its nodes to a reference node (mesh.ties)"
                )
    return tuple(found)


def beyond_range(config: PlacementConfig, mesh: Mesh) -> tuple[str, ...]:
    """A sentence for every parameter whose value in the deck lies outside of its range."""
    found = []
    known = {name: own for name, own in config.parameters.items() if own.property != DAMPING and not own.springs}
    for name, own in known.items() if config.mesh.matrices is None and config.mesh.results is None else ():
        for region in places_of(name, own, mesh, config.mesh)[0]:
            value, (low, high) = value_of(mesh, region, own.property, own.material), own.range
            if not low <= value <= high:
                found.append(
                    f"{name} is {value:.4g} in {mesh.regions[region]} of the deck, outside parameters.{name}.range, {low:g} to "
                    f"{high:g}: widen the range, or correct the deck, the region or the guess"
                )
                break
    return tuple(found)


def _nodes(blocks: Sequence[CellBlock | ShellBlock | BeamBlock]) -> np.ndarray:
    """Nodes (indices) of elements."""
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(block.nodes.ravel() for block in blocks)]))
