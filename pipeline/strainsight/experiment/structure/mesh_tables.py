"""Tables of the imported mesh and the model assumptions: cards, connections, rigid-body check, mass by region, and differences
from the program of the deck."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.decks.faults import plural
from strainsight.errors import StrainsightError
from strainsight.experiment.structure.mesh import free_motions
from strainsight.fem.checks import POOR, Quality
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.shells_and_beams import thin_mass
from strainsight.fem.stiff_pieces import parts
from strainsight.fem.support import EXACT, links
from strainsight.mesh.anisotropic import CompositeSolid
from strainsight.mesh.coincident import Coincident, Joints, joined_parts
from strainsight.mesh.joins import NodalForces, PointMass, Springs
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import lost
from strainsight.runner.output import Table
from strainsight.sensors.faces import Faces

Row = tuple[str, str, str]
LONGEST = 12
"""Most rows of one kind in a table."""

FACES = 24
"""Most faces that are listed."""


def build_mesh_tables(
    mesh: Mesh, weight: tuple[float, np.ndarray] | None, quality: Sequence[Quality], warnings: Sequence[str]
) -> tuple[Table, ...]:
    """Table of nodes, elements, materials, supports, ties, sets, quality, mass, ignored cards, notes and warnings.

    weight: mass [kg] and centre (3,) [m], None without densities."""
    rows: list[Row] = _geometry(mesh)
    rows += _regions(mesh)
    rows += _constraints(mesh)
    rows += _sets(mesh)
    rows += [_quality(entry) for entry in quality if len(entry.ids)]
    if weight is not None:
        rows.append(("mass", f"{weight[0]:.6g} kg", "centre ({:.4g}, {:.4g}, {:.4g}) m".format(*weight[1])))
    rows += [("ignored", card, _times(count, mesh.effect.get(card))) for card, count in mesh.ignored.items()]
    # sentences only in the last column, to keep the others narrow
    rows += [("note", "", text) for text in mesh.notes]
    rows += [("warning", "", text) for text in (*warnings, *_poor(quality))]
    return (Table("mesh", ("item", "number", "detail"), tuple(rows)),)


def faces_table(faces: Faces) -> Table:
    """Table of the largest faces with a point that selects each in a config."""
    count = len(faces.area)
    rows = []
    for face in range(min(count, FACES)):
        rows.append((f"{faces.area[face]:.3g} m²", faces.in_words(face), f"near: {faces.near(face)}"))
    title = "faces of the surface"
    if count > FACES:
        title += f" ({FACES} largest of {count}; import.h5 contains all faces)"
    return Table(title, ("area", "shape", "entry of mesh.faces"), tuple(rows))


def _times(count: int, effect: str | None) -> str:
    return plural(count, "time") + ", without effect" * (effect == "none")


def _geometry(mesh: Mesh) -> list[Row]:
    low, high = mesh.position.min(axis=0), mesh.position.max(axis=0)
    span = f"ids {mesh.node_ids.min()} to {mesh.node_ids.max()}"
    box = ", ".join(f"{axis} {a:.4g} … {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True))
    rows = [("nodes", str(mesh.own_nodes), span), ("extent", f"{np.linalg.norm(high - low):.4g} m", box)]
    return rows + [(b.kind, str(len(b.ids)), f"ids {b.ids.min()} to {b.ids.max()}") for b in mesh.elements]


def _regions(mesh: Mesh) -> list[Row]:
    rows = []
    for region in mesh.regions.values():
        count = Counter({b.kind: int(np.sum(b.region == region.id)) for b in mesh.elements})
        material = mesh.materials.get(region.material)
        detail = "no material" if mesh.laminate(region.id) is None else _plies(mesh, region.id)
        if material is not None:
            detail = (
                f"{material}: E {material.youngs_modulus:.4g} Pa, nu {material.poisson_ratio:.10g}, "
                f"rho {material.density:.5g} kg/m³"
            )
        if (shell := mesh.general_shell(region.id)) is not None:
            detail = f"shell with several or anisotropic materials, {shell.thickness:.4g} m thick, rho {shell.density:.5g} kg/m³"
        if (solid := mesh.anisotropic_of(region.id)) is not None:
            moduli, axes = ", ".join(f"{E:.4g}" for E in solid.moduli), mesh.orientations.get(region.id)
            kind = "basic" if axes is None else axes.system.kind
            detail = f"{solid}, anisotropic: E {moduli} Pa along its {kind} axes, rho {solid.density:.5g} kg/m³"
        if (composite := mesh.composites.get(region.id)) is not None:
            detail = _layers(mesh, region.id, composite)
        rows.append(
            (f"region {region.id} {region.name}", ", ".join(f"{n} {kind}" for kind, n in count.items() if n), detail)
        )
    return rows


def _plies(mesh: Mesh, region: int) -> str:
    """Describe a laminate: plies by material, thickness and density."""
    laminate, density = mesh.laminate(region), mesh.density_of(region)
    assert laminate is not None
    of = Counter(ply.material for ply in laminate.plies)
    counted = ", ".join(f"{n} of {mesh.laminae.get(i) or mesh.materials.get(i)}" for i, n in of.items())
    return f"{len(laminate.plies)} plies ({counted}), {laminate.thickness:.4g} m thick, mean rho {density:.5g} kg/m³"


def _layers(mesh: Mesh, region: int, composite: CompositeSolid) -> str:
    """Describe a composite solid: layers by material, stacking direction and density."""
    of = Counter(layer.material for layer in composite.layers)
    counted = ", ".join(f"{n} of {mesh.anisotropic.get(i) or mesh.materials.get(i)}" for i, n in of.items())
    return (
        f"{len(composite.layers)} layers ({counted}) along direction {composite.direction + 1} of each element, mean rho "
        f"{mesh.density_of(region):.5g} kg/m³"
    )


def _constraints(mesh: Mesh) -> list[Row]:
    supported = len(np.unique(mesh.fixed[:, 0]))
    rows = [("fixed", plural(len(mesh.fixed), "component"), plural(supported, "node"))]
    if mesh.axes:
        rows.append(("local displacement coordinate systems", plural(len(mesh.axes), "node"), ""))
    ties = {
        kind: [
            (str(tie), plural(len(tie.nodes), "node"), f"reference node {mesh.node_ids[tie.reference]}")
            for tie in elements
        ]
        for kind, elements in (("rigid elements", mesh.rigid), ("averaging elements", mesh.averaging))
    }
    kinds: dict[str, list[Row]] = {
        **ties,
        "relations": [
            (
                str(relation),
                plural(len(relation.node), "motion"),
                f"dependent degree of freedom: node {mesh.node_ids[relation.follower[0]]} component {relation.follower[1] + 1}",
            )
            for relation in mesh.relations
        ],
        "point masses": [
            (f"point mass {p.id}", f"{p.mass:.6g} kg", f"node {mesh.node_ids[p.node]}{_lever(p)}")
            for p in mesh.point_masses
        ],
        "springs": [
            (
                str(group),
                plural(len(group.stiffness), "spring"),
                f"{plural(len(np.unique(group.node)), 'node')}{_total(group)}",
            )
            for group in mesh.springs
        ],
        "loads": [
            (f"load {name}", plural(len(load.nodes), "node"), _resultant(load)) for name, load in mesh.loads.items()
        ],
    }
    return [*rows, *(row for what, listed in kinds.items() for row in _shortened(listed, what))]


def _resultant(load: NodalForces) -> str:
    force = "resultant ({:.4g}, {:.4g}, {:.4g}) N".format(*load.force.sum(axis=0))
    if load.moment is None:
        return force
    return force + ", moments ({:.4g}, {:.4g}, {:.4g}) N m".format(*load.moment.sum(axis=0))


def _total(springs: Springs) -> str:
    """Total stiffness of its translational and rotational springs."""
    turns = springs.torsion
    words = ((springs.stiffness[~turns].sum(), "N/m"), (springs.stiffness[turns].sum(), "N m/rad"))
    return "".join(f", {value:.4g} {unit}" for value, unit in words if value)


def _lever(point: PointMass) -> str:
    words = []
    if np.any(point.offset):
        words.append("offset ({:.4g}, {:.4g}, {:.4g}) m".format(*point.offset))
    if np.any(point.inertia):
        words.append("inertia {:.4g}, {:.4g}, {:.4g} kg m²".format(*np.diag(point.inertia)))
    if point.matrix is not None:
        masses, inertia = np.split(np.diag(point.matrix), 2)
        words.append("along x, y, z {:.4g}, {:.4g}, {:.4g} kg".format(*masses))
        words += ["inertia {:.4g}, {:.4g}, {:.4g} kg m²".format(*inertia)] if np.any(inertia) else []
    return "".join(f", {word}" for word in words)


def _sets(mesh: Mesh) -> list[Row]:
    faces = [(f"face {name}", plural(len(facets), "facet"), "") for name, facets in mesh.faces.items()]
    sets = {name: ids for name, ids in mesh.node_sets.items() if name not in mesh.faces}
    nodes = [(f"node set {name}", plural(len(ids), "node"), "") for name, ids in sets.items()]
    elements = [(f"element set {name}", plural(len(ids), "element"), "") for name, ids in mesh.element_sets.items()]
    return faces + _shortened(nodes, "node sets") + _shortened(elements, "element sets")


def _shortened(rows: list[Row], what: str) -> list[Row]:
    if len(rows) <= LONGEST:
        return rows
    return [*rows[:LONGEST], (what, f"{len(rows)} in total", "import.h5 lists all sets")]


def _quality(quality: Quality) -> Row:
    worst = int(np.argmin(quality.shape))
    least = f"smallest shape quality {quality.shape[worst]:.3f} (element {quality.ids[worst]})"
    detail = f"{least}, smallest Jacobian ratio {quality.curvature.min():.3f}"
    return (f"shape quality of {quality.kind}", f"mean {quality.shape.mean():.3f}", detail)


def _poor(quality: Sequence[Quality]) -> list[str]:
    sentences = []
    for entry in quality:
        poor = np.flatnonzero(entry.shape < POOR)
        if poor.size:
            named = poor[np.argsort(entry.shape[poor])][:5]
            listed = ", ".join(f"{entry.ids[i]} ({entry.shape[i]:.2g})" for i in named) + (
                ", …" if poor.size > 5 else ""
            )
            have = f"{entry.kind} element{'s have' if poor.size > 1 else ' has'}"
            sentences.append(f"{poor.size} {have} a shape quality below {POOR:g} (1 is regular): {listed}")
    return sentences


ASSUMES = "model assumptions"
MOST = 24
"""Most regions whose mass is listed."""


def assumed_table(mesh: Mesh, program: str, free: bool) -> Table:
    """Table of the model assumptions; program: of the deck (`format_of`); free: whether the structure may be unsupported."""
    contacts = (("contact", "", text) for text in mesh.contacts)
    rows = (
        *contacts,
        *_cards(mesh),
        *_connections(mesh),
        *_rigid(mesh, free),
        *_masses(mesh),
        *_differences(mesh, program),
    )
    return Table(ASSUMES, ("item", "number", "detail"), rows)


def _cards(mesh: Mesh) -> Iterator[Row]:
    for card, count in sorted(mesh.read.items()):
        ignored = sum(n for name, n in mesh.ignored.items() if card in (name, name.split(" that ")[0]))
        if count != ignored:
            yield (f"card {card}", str(count - ignored), "read")
    for card, count in mesh.ignored.items():
        yield (f"card {card}", str(count), _fate(card, mesh.effect.get(card, "")))


def _fate(card: str, effect: str) -> str:
    """Describe why a card is ignored."""
    if " that no " in card or " not selected" in card:
        return "ignored: no other card refers to it"
    if effect == "structure":
        return f"the model differs from the deck: {lost(card)}"
    if effect == "none":
        return "ignored: no effect on stiffness, mass or supports"
    return "ignored: effect unknown"


def _connections(mesh: Mesh) -> Iterator[Row]:
    if not mesh.elements:
        return
    joints = Joints(mesh)
    tied = np.unique(joined_parts(mesh, joints)[mesh.nodes_of_elements])
    yield (
        "parts without common nodes",
        str(parts(mesh).count),
        f"number of parts if ties, equations and springs count as connections: {len(tied)}",
    )
    coincident = Coincident(mesh, joints)
    yield ("coincident nodes that are not connected", str(len(coincident.unjoined)), "")
    if mesh.shells:
        rings = [
            np.stack([block.corners, np.roll(block.corners, -1, axis=1)], axis=2).reshape(-1, 2)
            for block in mesh.shells
        ]
        _, count = np.unique(np.sort(np.concatenate(rings), axis=1), axis=0, return_counts=True)
        several = f"edges with more than two shells: {int((count > 2).sum())}"
        yield ("free edges of shells", str(int((count == 1).sum())), several)


def _rigid(mesh: Mesh, free: bool) -> Iterator[Row]:
    if mesh.elements:
        try:
            left = free_motions(mesh)
            words = ", ".join(left[:8]) + (f" and {len(left) - 8} more" if len(left) > 8 else "")
            yield ("rigid-body check: free motions", str(len(left)), words + " (mesh.free)" * (free and bool(left)))
        except StrainsightError as error:
            yield ("rigid-body check: free motions", "?", error.what)
    between = links(mesh)
    ground = sum(link.share > EXACT for link in between)
    detail = (
        f"{ground} springs or equations resist a rigid-body motion; largest relative elongation or residual under this motion: "
        f"{between[0].share:.2g} ({between[0].name})"
        if between
        else ""
    )
    yield ("rigid-body check: springs and constraint equations between nodes", str(len(between)), detail)
    supports = len(np.unique(mesh.fixed[:, 0]))
    yield ("supported nodes", str(supports), plural(len(mesh.fixed), "fixed component"))


def _masses(mesh: Mesh) -> Iterator[Row]:
    """Mass of every region, and of point masses."""
    if any(mesh.density_of(number) is None for number in mesh.regions):
        return
    of: dict[int, float] = dict.fromkeys(mesh.regions, 0.0)
    for part, values in element_mass_parts(mesh):
        a, b = np.triu_indices(part.nodes.shape[1])
        mass = values @ np.where(a == b, 1.0, 2.0)
        for number in np.unique(part.region):
            of[int(number)] += float(mass[part.region == number].sum())
    for number in list(of)[:MOST]:
        ids = [block.ids[block.region == number] for block in mesh.thin]
        if any(len(those) for those in ids):
            M, _ = thin_mass(mesh, np.concatenate(ids))
            along = np.zeros((M.shape[0] // 6, 6))
            along[:, 0] = 1.0
            of[number] += float(along.ravel() @ (M @ along.ravel()))
        name = mesh.regions[number].name
        yield (f"mass of region {number} {name}", f"{of[number]:.6g} kg", f"{mesh.density_of(number):.5g} kg/m³")
    if len(of) > MOST:
        yield ("mass of other regions", "", f"{len(of) - MOST} regions whose mass is not listed")
    if mesh.point_masses:
        yield (
            "point masses",
            f"{sum(point.mass for point in mesh.point_masses):.6g} kg",
            f"number: {len(mesh.point_masses)}",
        )


def _differences(mesh: Mesh, program: str) -> Iterator[Row]:
    """Differences from other programs that apply to this mesh."""
    kinds = {block.kind for block in mesh.elements}
    for text in (
        "the model is linear about the unloaded state: no preload, contact, large displacements or temperature",
        "damping is taken from the config, not from the deck",
        "the mass matrix of solids is lumped (mesh.mass or PARAM,COUPMASS): diagonal of the consistent matrix, scaled to the "
        "element mass; on coarse meshes frequencies are lower than with consistent mass"
        if mesh.lumped
        else {
            "nastran": "the mass matrix is consistent; Nastran uses lumped mass unless PARAM,COUPMASS is 1 (mesh.mass: lumped), "
            "with lower frequencies on coarse meshes",
            "abaqus": "the mass matrix is consistent; Abaqus uses lumped mass for first-order elements, with lower frequencies "
            "on coarse meshes",
        }.get(program, "the mass matrix is consistent"),
        "hex8 elements have incompatible modes and bend without locking; without incompatible modes they are stiffer"
        if "hex8" in kinds
        else "",
        "linear tetrahedra, wedges and pyramids are too stiff in bending"
        if kinds & {"tet4", "wedge6", "pyra5"}
        else "",
        "the drilling stiffness of shells is computed from their membrane stiffness; K6ROT is not used"
        if mesh.shells
        else "",
        "beams use the shear factors of their section; the slenderness compensation of Abaqus is not applied"
        if program == "abaqus" and mesh.beams
        else "",
        "nodes of solids have no rotations: shells and beams connected to them can rotate freely there"
        if any(kind_of(block.kind).corners for block in mesh.blocks) and mesh.thin
        else "",
    ):
        if text:
            yield ("differs", "", text)
