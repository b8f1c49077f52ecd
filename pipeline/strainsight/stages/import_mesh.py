"""import: the mesh and all that its file and the config say about it, in SI units, with the ids of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.decks.reader import format_of
from strainsight.experiment.structure.mesh import checked, contact_warnings, mesh_of, model_warnings
from strainsight.experiment.structure.mesh_tables import assumed_table, build_mesh_tables, faces_table
from strainsight.experiment.structure.references import check_references, on_one_node, range_warnings
from strainsight.fem.checks import Quality
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import ignored_structure, size_of
from strainsight.mesh.vtkhdf import VtkHdf, unstructured_grid
from strainsight.records.mesh import Imported, MeshColumns, vtkhdf_datasets
from strainsight.records.record import written
from strainsight.runner.output import Output, warning_texts
from strainsight.runner.stage import Context
from strainsight.sensors.faces import faces_of


def run(context: Context[PlacementConfig]) -> Output:
    """Read the deck, convert its units, add what the config adds, check it, weigh it."""
    config = context.config.mesh
    file = context.files["mesh.file"]
    used = [load.deck_load for load in context.config.loads.values() if load.deck_load is not None]
    mesh = mesh_of(config, file, base=context.base, loads=used)
    weight, quality, warnings = looked_at(context.config, mesh)
    alone = on_one_node(context.config.loads, mesh)
    faces = None
    if mesh.has_surface:
        facets = exterior_facets(mesh)
        faces = faces_of(mesh.position, facets)
        warnings += tuple(contact_warnings(context.config, mesh, facets, faces))
    grid, grid_attributes = vtkhdf_datasets(_grid(mesh))
    count = sum(len(block.ids) for block in mesh.elements)
    kinds = ", ".join(f"{len(block.ids)} {block.kind}" for block in mesh.elements)
    ignored = sum(mesh.ignored.values())
    felt = () if config.matrices or config.results else tuple(ignored_structure(mesh))
    which = (
        f" ({', '.join(felt[:3])}{', …' * (len(felt) > 3)} may change the stiffness or mass; see the tables of the stage import)"
        if felt
        else ""
    )
    parts = [f"{mesh.own_nodes} nodes", kinds, f"{ignored} card{'s' * (ignored != 1)} ignored{which}"]
    summary: dict[str, Any] = {"nodes": mesh.own_nodes, "elements": count, "ignored": ignored, "extent": size_of(mesh)}
    if weight is not None:
        summary["mass"] = float(weight[0])
        parts.append(f"mass {weight[0]:.5g} kg")
    tables = build_mesh_tables(mesh, weight, quality, (*warnings, *alone))
    summary["warnings"] = len(warning_texts(tables))
    program = format_of(file) if config.format == "auto" else config.format
    computed = config.matrices is None and config.results is None
    assumed = assumed_table(mesh, program, config.free) if computed else None
    return Output(
        datasets=written(Imported(mesh=MeshColumns.of(mesh), detected_faces=faces)) | grid,
        attributes=grid_attributes,
        summary=summary,
        message=", ".join(part for part in parts if part),
        tables=(*tables, *((faces_table(faces),) if faces else ()), *((assumed,) if assumed else ())),
        inputs=tuple(Path(name) for name in mesh.included),
    )


def looked_at(
    config: PlacementConfig, mesh: Mesh
) -> tuple[tuple[float, np.ndarray] | None, tuple[Quality, ...], tuple[str, ...]]:
    """Mass [kg] with centre (3,) [m], shapes of the elements, and what is more likely a mistake than meant, in sentences. Raises
    UserError for what cannot be computed."""
    section = config.mesh
    weight, quality = checked(mesh, section)
    check_references(config, mesh)
    warnings: tuple[str, ...] = ()
    if (
        section.matrices is None and section.results is None
    ):  # with imported matrices, materials and unused nodes have no effect
        warnings = model_warnings(mesh, section.length_unit, section.mass_unit, section.free)
    return weight, quality, (*warnings, *range_warnings(config, mesh))


def _grid(mesh: Mesh) -> VtkHdf:
    ids = [block.ids for block in mesh.elements]
    region = [block.region for block in mesh.elements]
    n = mesh.own_nodes  # those on faces of shells come after them
    return unstructured_grid(
        mesh.position[:n],
        mesh.elements,
        point_data={"node_id": mesh.node_ids[:n]},
        cell_data={"element_id": np.concatenate(ids), "region": np.concatenate(region)} if ids else {},
    )
