"""import: the deck as it stands, in SI units, with the ids of the file and a list of what was not taken over."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from strainsight.errors import blame
from strainsight.fem.assembly import mass_properties
from strainsight.mesh.check import suspicions
from strainsight.mesh.model import Mesh
from strainsight.mesh.reader import read_mesh
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.stages.records.grids import vtkhdf_datasets
from strainsight.stages.records.mesh import mesh_datasets
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Read the deck, convert its units, weigh it."""
    units = context.config.mesh
    with blame("mesh.file"):
        mesh = read_mesh(context.files["mesh.file"], units.length_unit, units.mass_unit)
        mass, centre = mass_properties(mesh)
    ids = np.concatenate([block.ids for block in mesh.blocks])
    region = np.concatenate([block.region for block in mesh.blocks])
    grid, grid_attributes = vtkhdf_datasets(
        unstructured_grid(
            mesh.position,
            mesh.blocks,
            point_data={"node_id": mesh.node_ids},
            cell_data={"element_id": ids, "region": region},
        )
    )
    ignored = sum(mesh.ignored.values())
    elements = ", ".join(f"{len(block.ids)} {block.kind}" for block in mesh.blocks)
    return Output(
        datasets=mesh_datasets(mesh) | grid,
        attributes=grid_attributes,
        summary={"nodes": len(mesh.node_ids), "elements": len(ids), "mass": float(mass), "ignored": ignored},
        message=f"{len(mesh.node_ids)} nodes, {elements}, {ignored} card{'s' * (ignored != 1)} ignored, mass {mass:.5g} kg",
        tables=_tables(mesh, mass, centre),
        inputs=tuple(Path(name) for name in mesh.included),
    )


def _tables(mesh: Mesh, mass: float, centre: np.ndarray) -> tuple[Table, ...]:
    rows = []
    for region in mesh.regions.values():
        material = mesh.materials[region.material]
        count = Counter({b.kind: int(np.sum(b.region == region.id)) for b in mesh.blocks})
        rows.append(
            (
                f"region {region.id} {region.name}",
                ", ".join(f"{n} {kind}" for kind, n in count.items() if n),
                f"E {material.youngs_modulus:.4g} Pa, nu {material.poisson_ratio:g}, rho {material.density:.5g} kg/m³",
            )
        )
    rows.append(("fixed", f"{len(mesh.fixed)} components", f"{len(np.unique(mesh.fixed[:, 0]))} nodes"))
    rows += [
        (f"rigid element {e.id}", f"{len(e.nodes)} nodes", f"reference node {mesh.node_ids[e.reference]}")
        for e in mesh.rigid
    ]
    rows += [
        (f"averaging element {e.id}", f"{len(e.nodes)} nodes", f"reference node {mesh.node_ids[e.reference]}")
        for e in mesh.averaging
    ]
    rows.append(("mass", f"{mass:.4f} kg", "centre ({:.4g}, {:.4g}, {:.4g}) m".format(*centre)))
    rows += [("not taken over", card, f"{count} times") for card, count in mesh.ignored.items()]
    rows += [("warning", text, "") for text in suspicions(mesh)]
    return (Table("the mesh", ("what", "how many", "detail"), tuple(rows)),)


IMPORT = Stage("import", version=1, reads=("mesh",), upstream=(), files=("mesh.file",), run=run)
