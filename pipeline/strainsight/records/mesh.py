"""import.h5: a `Mesh` by columns, its faces, and grids for ParaView."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np

from strainsight.columns import Column
from strainsight.mesh.anisotropic import Anisotropic, CompositeSolid, Orientation
from strainsight.mesh.joins import AveragingElement, NodalForces, PointMass, Relation, RigidElement, Springs
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.thin import (
    BEAM_KINDS,
    SHELL_KINDS,
    BeamBlock,
    BeamSection,
    FloatArray,
    GeneralShell,
    IntArray,
    Lamina,
    Laminate,
    Section,
    ShellBlock,
    ShellSection,
)
from strainsight.mesh.vtkhdf import VtkHdf, unstructured_grid
from strainsight.records.record import Source, dataset, group, read, record
from strainsight.records.table import Key, table
from strainsight.runner.output import Dataset
from strainsight.sensors.faces import Faces


@dataclass(frozen=True)
class Members:
    members: Annotated[IntArray, Column("1", "member", "ids of the <what> in every set")]


@dataclass(frozen=True)
class NamedFacets:
    facets: Annotated[
        IntArray,
        Column("1", "named facet × 2", "element id of every facet of the face, and facet number in the element"),
    ]


@dataclass(frozen=True)
class Axes:
    direction: Annotated[
        FloatArray,
        Column(
            "1",
            "3 × 3",
            "unit vectors of the local displacement coordinate system of every node, in global axes, as columns",
        ),
    ]


@dataclass(frozen=True)
class Ignored:
    count: Annotated[int, Column("1", "", "number of occurrences of the unsupported card in the deck")]
    effect: Annotated[
        str,
        Column(
            "1",
            "",
            "effect of the unsupported card on the model: structure (may affect stiffness, mass or ties), none, or "
            "empty (unknown)",
        ),
    ]


SECTION, SET = Key("region", int, "region id of every shell section"), Key("name", str, "name of every set of <what>")
LAMINATE = Key("region", int, "region id of every laminate")
BEAM_END = Key("region", int, "region id of every beam section; two rows if the ends A and B differ", several=True)
REGION, NAMED_FACE = (
    Key("region", int, "region id"),
    Key("name", str, "name of every face; the node set of the face has the same name"),
)
LOAD, CARD = Key("name", str, "name of every load of the deck"), Key("card", str, "name of every unsupported card")
TURNED = Key("node", int, "index of every node with a local displacement coordinate system")


@record
class MeshColumns:
    """`Mesh`, with the same field names; lengths in m."""

    node_ids: np.ndarray = dataset("1", "/nodes/id", "node ids of the deck", path="/nodes/id")
    position: np.ndarray = dataset("m", "/nodes/id × 3", "node positions", path="/nodes/position")
    blocks: tuple[CellBlock, ...] = group(path="/cells/<name>", by="kind")
    shells: tuple[ShellBlock, ...] = group(by="kind")
    beams: tuple[BeamBlock, ...] = group(by="kind")
    arms: np.ndarray = dataset(
        "1",
        "arm × 2",
        "node indices of both ends of every rigid link between a shell or beam and an added node on its surface. First the added "
        "node, then the node of the shell or beam",
    )
    regions: Mapping[int, Region] = group(table(Region, "region", "id"))
    shell_sections: Mapping[int, ShellSection] | None = group(
        table(ShellSection, "shell section", SECTION), path="/sections/shells"
    )
    general_shells: Mapping[int, GeneralShell] | None = group(
        table(GeneralShell, "general shell", SECTION), path="/sections/general"
    )
    beam_ends: list[tuple[int, BeamSection]] | None = group(table(BeamSection, "end", BEAM_END), path="/sections/beams")
    laminates: Mapping[int, Laminate] | None = group(table(Laminate, "laminate", LAMINATE), path="/sections/laminates")
    laminae: Mapping[int, Lamina] | None = group(table(Lamina, "lamina", "id"))
    materials: Mapping[int, Material] = group(table(Material, "material", "id"))
    anisotropic: Mapping[int, Anisotropic] | None = group(table(Anisotropic, "anisotropic", "id"))
    orientations: Mapping[int, Orientation] | None = group(table(Orientation, "orientation", REGION))
    composites: Mapping[int, CompositeSolid] | None = group(
        table(
            CompositeSolid,
            "composite",
            REGION,
            kind="type of the coordinate system in which the layer axes are defined: rectangular, cylindrical, spherical",
            turn="directions of the layer axes 1, 2, 3, as columns, in the coordinate system of `kind`",
        )
    )
    fixed: np.ndarray = dataset(
        "1",
        "fixed degree of freedom × 2",
        "fixed degrees of freedom, as [node index, component]; component 0-2: translations, 3-5: rotations",
        path="/constraints/fixed",
    )
    rigid: tuple[RigidElement, ...] = group(table(RigidElement, "rigid element"), path="/constraints/rigid")
    averaging: tuple[AveragingElement, ...] = group(
        table(AveragingElement, "averaging element"), path="/constraints/averaging"
    )
    relations: tuple[Relation, ...] = group(
        table(Relation, "relation", brief=("component", "value")), path="/constraints/relations"
    )
    axes: Mapping[int, FloatArray] = group(table(Axes, "turned node", TURNED, bare=True), path="/constraints/axes")
    point_masses: tuple[PointMass, ...] = group(table(PointMass, "mass"), path="/masses")
    springs: tuple[Springs, ...] = group(table(Springs, "support", brief=("node", "component", "value")))
    loads: Mapping[str, NodalForces] = group(table(NodalForces, "load", LOAD))
    node_sets: Mapping[str, IntArray] = group(table(Members, "set", SET, bare=True), path="/sets/nodes", what="nodes")
    element_sets: Mapping[str, IntArray] = group(
        table(Members, "set", SET, bare=True), path="/sets/elements", what="elements"
    )
    faces: Mapping[str, IntArray] = group(table(NamedFacets, "name", NAMED_FACE, bare=True), path="/faces/named")
    cards: Mapping[str, Ignored] = group(table(Ignored, "card", CARD), path="/ignored")
    notes: tuple[str, ...] = dataset("1", "note", "assumptions made in reading the deck")
    doubts: tuple[str, ...] = dataset("1", "doubt", "probable mistakes in the deck")
    contacts: tuple[str, ...] | None = dataset(
        "1", "pair", "treatment of each contact pair of the deck; missing if the deck has no contact", default=None
    )
    lumped: int | None = dataset("1", "", "1: lumped mass of the solids; missing: consistent mass", default=None)

    @classmethod
    def of(cls, mesh: Mesh) -> MeshColumns:
        beams = [(region, section) for region, section in mesh.sections.items() if isinstance(section, BeamSection)]
        columns: dict[str, Any] = {name: getattr(mesh, name) for name in _shared()} | {
            "fixed": mesh.fixed.reshape(-1, 2),
            "shell_sections": _sections(mesh, ShellSection),
            "general_shells": _sections(mesh, GeneralShell),
            "laminates": _sections(mesh, Laminate),
            "beam_ends": [
                (region, end) for region, section in beams for end in (section, section.at_b) if end is not None
            ],
            "cards": {card: Ignored(count, mesh.effect.get(card, "")) for card, count in mesh.ignored.items()},
            "lumped": int(mesh.lumped),
        }
        return cls(**columns | {name: columns[name] or None for name in WHERE_THERE})

    def restore(self) -> Mesh:
        columns = {name: getattr(self, name) for name in _shared()}
        beams: dict[int, BeamSection] = {}
        for region, end in reversed(self.beam_ends or ()):  # end B first
            beams[region] = replace(end, at_b=beams.get(region))
        sections: dict[int, Section] = {**beams}
        for part in (self.shell_sections, self.general_shells, self.laminates):
            sections |= part or {}
        columns |= {
            "blocks": _ordered(self.blocks, [known.name for known in ELEMENTS]),
            "shells": _ordered(self.shells, SHELL_KINDS),
            "beams": _ordered(self.beams, BEAM_KINDS),
            "sections": {region: sections[region] for region in self.regions if region in sections},
            "ignored": {card: entry.count for card, entry in self.cards.items()},
            "effect": {card: entry.effect for card, entry in self.cards.items() if entry.effect},
            "lumped": bool(self.lumped),
        }
        return Mesh(**{name: value for name, value in columns.items() if value is not None})


WHERE_THERE = (
    "shell_sections", "general_shells", "beam_ends", "laminates", "laminae", "anisotropic", "orientations", "composites",
    "contacts", "lumped",
)  # fmt: skip
"""Columns that a file omits if they are empty."""


def _shared() -> set[str]:
    """Fields with columns of the same name."""
    return {field.name for field in fields(Mesh)} & {field.name for field in fields(MeshColumns)}


def _sections(mesh: Mesh, kind: type[Section]) -> dict[int, Any]:
    return {region: section for region, section in mesh.sections.items() if isinstance(section, kind)}


def _ordered(blocks: Sequence[Any], kinds: Sequence[str]) -> tuple[Any, ...]:
    return tuple(sorted(blocks, key=lambda block: kinds.index(block.kind)))


@record
class Meshes:
    """import.h5 of a bench."""

    bodies: dict[str, Mesh] = group(MeshColumns)


def mesh_from(source: Source, below: str = "") -> Mesh:
    """The mesh of an import, or of a body in a bench."""
    return read(MeshColumns, source, below).restore()


@record
class Imported:
    """import.h5 of a structure."""

    mesh: MeshColumns = group(path="")
    detected_faces: Faces | None = group(path="/faces/detected", default=None)


STRAIN = "m/m"
UNITS = {
    "displacement": "m",
    "motion": "m",
    "strain": STRAIN,
    "strain_std": STRAIN,
    "stress": "Pa",
    "von_mises": "Pa",
    "von_mises_std": "Pa",
    "principal": "Pa",
    "equivalent_range": "Pa",
    "equivalent_range_of_mean": "Pa",
}
"""Units of point and cell data in grids, by name."""


def vtkhdf_datasets(
    grid: VtkHdf, units: Mapping[str, str] = UNITS
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Datasets and attributes of a grid, with the paths of the VTKHDF format; units: data name → unit."""
    datasets = {f"/VTKHDF/{path}": Dataset(array, "", "") for path, array in grid.datasets.items()}
    attributes = {f"/VTKHDF/{path}".rstrip("/"): dict(values) for path, values in grid.attributes.items()}
    for path in grid.datasets:
        where, _, name = path.partition("/")
        if where in ("PointData", "CellData") and name in units:
            attributes[f"/VTKHDF/{path}"] = {"units": units[name]}
    return datasets, attributes


def gauge_grid(
    position: np.ndarray, data: Mapping[str, np.ndarray], units: Mapping[str, str] = UNITS
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Gauges as a point cloud (m, 3) [m] with data (m, ...); units as in `vtkhdf_datasets`."""
    index = np.arange(len(position))
    return vtkhdf_datasets(
        unstructured_grid(position, (CellBlock("vertex", index, index[:, None], index),), point_data=data), units
    )
