"""import: the mesh and all that its file and the config say about it, in SI units, with the ids of the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.decks.numbers import LARGEST_ID
from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError, blame
from strainsight.fem.assembly import mass_properties
from strainsight.fem.checks import check_geometry, check_mesh
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.quality import Quality, element_quality
from strainsight.mesh.additions import (
    node_index,
    node_indices,
    with_averaging_element,
    with_material,
    with_node,
    with_rigid_element,
    with_support,
)
from strainsight.mesh.model import Mesh
from strainsight.mesh.suspicions import suspicions
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.records.grids import vtkhdf_datasets
from strainsight.records.mesh import MeshColumns
from strainsight.records.record import written
from strainsight.stages.pages.found import found_tables
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Read the deck, convert its units, add what the config adds, check it, weigh it."""
    config = context.config.mesh
    mesh = mesh_of(config, context.files["mesh.file"])
    weight, quality = checked(mesh, config)
    grid, grid_attributes = vtkhdf_datasets(_grid(mesh))
    count = sum(len(block.ids) for block in mesh.blocks)
    kinds = ", ".join(f"{len(block.ids)} {block.kind}" for block in mesh.blocks)
    ignored = sum(mesh.ignored.values())
    parts = [f"{len(mesh.node_ids)} nodes", kinds, f"{ignored} card{'s' * (ignored != 1)} ignored"]
    summary: dict[str, Any] = {"nodes": len(mesh.node_ids), "elements": count, "ignored": ignored}
    if weight is not None:
        summary["mass"] = float(weight[0])
        parts.append(f"mass {weight[0]:.5g} kg")
    return Output(
        datasets=written(MeshColumns.of(mesh)) | grid,
        attributes=grid_attributes,
        summary=summary,
        message=", ".join(part for part in parts if part),
        tables=found_tables(mesh, weight, quality, _doubts(mesh, config)),
        inputs=tuple(Path(name) for name in mesh.included),
    )


def mesh_of(config: Any, path: Path, key: str = "mesh") -> Mesh:
    """The mesh of a file and of what the config (its section at `key`) says beside it."""
    with blame(f"{key}.file"):
        mesh = read_mesh(
            path,
            config.length_unit,
            config.mass_unit,
            format=config.format,
            region_data=config.region_data,
            solids=config.matrices is None,
        )
    return with_additions(mesh, config, key)


def checked(mesh: Mesh, config: Any, key: str = "mesh") -> tuple[tuple[float, np.ndarray] | None, tuple[Quality, ...]]:
    """Mass [kg] with centre (3,) [m], where solids carry the model, and the shapes of the elements, once all is sound."""
    weight = None
    with blame(f"{key}.file"), mesh.located(), _config_ties(mesh, key):
        if config.matrices is None:
            check_mesh(mesh)
            weight = mass_properties(mesh)
            constraint_transform(mesh)  # so that ties and supports that contradict each other show here
        else:
            check_geometry(mesh)
        return weight, tuple(element_quality(mesh))


def with_additions(mesh: Mesh, config: Any, key: str = "mesh") -> Mesh:
    """The mesh with the materials, ties and supports that the config states beside the file."""
    for name, material in config.materials.items():
        with blame(f"{key}.materials.{name}.regions"):
            regions = None if material.regions == "all" else material.regions
            E, nu, rho = material.youngs_modulus, material.poisson_ratio, material.density
            mesh = with_material(mesh, regions, E, nu, rho, f"{key}.materials.{name}")
    for i, tie in enumerate(config.ties):
        with blame(f"{key}.ties.{i}"):
            nodes = node_indices(mesh, tie.set)
            if tie.reference >= LARGEST_ID:
                what = f"{tie.reference} is too large for the number of a node"
                raise DeckError(what, key=f"{key}.ties.{i}.reference", remedy="give one below 10^12")
            if tie.at is not None:
                mesh = with_node(mesh, tie.reference, tie.at)
            reference = node_index(mesh, tie.reference)
            if tie.type == "rigid":
                mesh = with_rigid_element(
                    mesh, reference, nodes, _components(tie.components or (1, 2, 3)), f"{key}.ties.{i}"
                )
            else:
                components = _components(tie.components or (1, 2, 3, 4, 5, 6))
                mesh = with_averaging_element(mesh, reference, nodes, components, f"{key}.ties.{i}")
    for i, support in enumerate(config.supports):
        with blame(f"{key}.supports.{i}"):
            nodes = np.array([node_index(mesh, support.node)]) if support.node else node_indices(mesh, support.set)
            mesh = with_support(mesh, nodes, _components(support.components))
    return mesh


@contextmanager
def _config_ties(mesh: Mesh, key: str) -> Iterator[None]:
    """An error about a tie of the config belongs to its key there, not to a line of the deck."""
    named = [(e.id, e.name) for e in mesh.rigid] + [(e.id, e.name) for e in mesh.averaging]
    keys = {("tie", number): name for number, name in named if name.startswith(f"{key}.ties.")}
    try:
        yield
    except DeckError as error:
        if error.key is None and error.entity in keys:
            error.key, error.entity = keys[error.entity], None
        raise


def _components(numbers: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sorted({number - 1 for number in numbers}))


def _doubts(mesh: Mesh, config: Any) -> tuple[str, ...]:
    """Sentences for a warning; with ready matrices the materials and the unused nodes of the file mean nothing."""
    if config.matrices is not None:
        return ()
    return suspicions(mesh, config.length_unit, config.mass_unit)


def _grid(mesh: Mesh) -> Any:
    ids = [block.ids for block in mesh.blocks]
    region = [block.region for block in mesh.blocks]
    return unstructured_grid(
        mesh.position,
        mesh.blocks,
        point_data={"node_id": mesh.node_ids},
        cell_data={"element_id": np.concatenate(ids), "region": np.concatenate(region)} if ids else {},
    )


IMPORT = Stage("import", version=2, reads=("mesh",), upstream=(), files=("mesh.file",), run=run)
