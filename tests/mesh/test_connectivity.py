"""What looks joined and is not: nodes in one place, meshes that do not fit together, solids inside of each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.stiff_pieces import hinge_warnings
from strainsight.mesh.connectivity import check_doubled, connectivity_warnings, merged
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement, Springs
from strainsight.mesh.projection import covered
from strainsight.mesh.thin import BeamBlock, ShellBlock, ShellSection

from ..bodies import body, held, moved, with_nodes
from ..fem.shell_models import sheet
from .boxes import FACE, TWO, both, box


def plates(*parts):
    """Quadrangles in the plane z = 0, of each part (counts, size, corner) with nodes of its own."""
    x, shells, first = np.zeros((0, 3)), [], 0
    for counts, size, at in parts:
        place = lambda a, b, size=size, at=at: np.add(at, np.column_stack([size[0] * a, size[1] * b, 0 * a]))  # noqa: E731
        mesh = sheet("quad4", *counts, place, ShellSection(0.01), box().materials[1], False)
        (own,) = mesh.shells
        shells.append(replace(own, ids=own.ids + first, nodes=own.nodes + len(x)))
        x, first = np.vstack([x, mesh.position]), first + len(own.ids)
    return replace(mesh, node_ids=np.arange(1, len(x) + 1), position=x, shells=tuple(shells))


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20", "wedge15", "pyra5"])
def test_valid_solid_mesh_gives_no_warning(kind):
    mesh = body(kind, (3, 2, 2), lambda x, y, z: (np.cos(x / 3) * (2 + y), np.sin(x / 3) * (2 + y), z))
    check_doubled(mesh)
    assert connectivity_warnings(mesh) == hinge_warnings(mesh) == ()
    assert not covered(mesh, exterior_facets(mesh)).any()


def bent(kind, counts, inner, outer, arc=2 * np.pi, turn=0.0):
    """Cells around, between two radii [m], and along, each 20 mm high."""

    def chart(x, y, z):
        r, angle = inner + (outer - inner) * y / counts[1], turn - arc * x / counts[0]
        return r * np.cos(angle), r * np.sin(angle), 0.02 * z

    return body(kind, counts, chart)


@pytest.mark.parametrize(("kind", "around", "thick"), [("hex20", 4, 2e-3), ("tet10", 8, 1e-3), ("hex8", 4, 2e-5)])
def test_thin_tube_wall_is_not_reported_as_hanging(kind, around, thick):
    mesh = bent(kind, (around, 1, 2), 0.1, 0.1 + thick, arc=np.pi / 2)
    assert connectivity_warnings(mesh) == ()
    assert not covered(mesh, exterior_facets(mesh)).any()


def pin_and_bush(clearance):
    """In a bush of 50 mm, 16 elements around each, turned against each other."""
    return both(
        merged(bent("hex20", (16, 1, 2), 0.05 + clearance, 0.06), 1e-9),
        merged(bent("hex20", (16, 1, 2), 0.03, 0.05, turn=0.11), 1e-9),
    )


@pytest.mark.parametrize("clearance", [2e-4, 1e-3])
def test_a_pin_with_clearance_neither_touches_its_bush_nor_overlaps_it(clearance):
    mesh = pin_and_bush(clearance)
    assert connectivity_warnings(mesh) == ()
    assert not covered(mesh, exterior_facets(mesh)).any()


def test_a_pin_without_clearance_touches_its_bush_and_a_thicker_one_overlaps_it():
    mesh = pin_and_bush(0.0)
    facets = exterior_facets(mesh)
    radius = np.hypot(*mesh.position[:, :2].T)
    meets = [np.allclose(radius[own[own >= 0]], 0.05) for own in facets.nodes]
    assert covered(mesh, facets).tolist() == meets
    (said,) = connectivity_warnings(mesh)
    assert "lie on the surface of elements without belonging to them" in said
    assert any("overlapping volumes" in said for said in connectivity_warnings(pin_and_bush(-3e-3)))


def test_facets_of_a_slit_are_covered_up_to_its_end():
    end = np.flatnonzero((TWO.position[:, :2] == [1, 0]).all(axis=1)).reshape(2, 3)
    stays, block = np.arange(len(TWO.position)), TWO.blocks[0]
    stays[end[1]] = end[0]
    slit = replace(TWO, blocks=(replace(block, nodes=stays[block.nodes]),))
    assert covered(slit, exterior_facets(slit)).sum() == 8


def test_unconnected_coincident_nodes_give_merge_distance():
    (said,) = connectivity_warnings(TWO)
    first, second = TWO.node_ids[FACE[:, 0]]
    assert said.startswith("18 nodes coincide with another")
    assert "Set mesh.merge to 1e-06" in said
    assert f"for example {first} and {second} at (1, " in said
    apart = replace(TWO, position=TWO.position + np.where(np.arange(54) > 26, 4e-5, 0)[:, None] * [1, 0, 0])
    (said,) = connectivity_warnings(apart)
    assert "Set mesh.merge to 0.0001" in said
    assert len(merged(apart, 1e-4).position) == 45
    gap = replace(TWO, position=TWO.position + np.where(np.arange(54) > 26, 4e-3, 0)[:, None] * [1, 0, 0])
    assert connectivity_warnings(gap) == ()


PAIRS, ALONG, TERMS = FACE.T.tolist(), (0, 1, 2), np.repeat(np.arange(9), 2)
JOINED = {
    "rigid elements": {"rigid": tuple(RigidElement(i, p, np.array([q]), ALONG) for i, (p, q) in enumerate(PAIRS))},
    "a rigid element of both sides": {"rigid": (RigidElement(1, 54, FACE.ravel(), ALONG),)},
    "averaging elements": {
        "averaging": tuple(AveragingElement(i, p, np.array([q]), np.ones(1), ALONG) for i, (p, q) in enumerate(PAIRS))
    },
    "relations": {
        "relations": tuple(
            Relation(i, np.array(pair), np.zeros(2, int), np.array([1.0, -1.0])) for i, pair in enumerate(PAIRS)
        )
    },
    "springs": {"springs": (Springs("CELAS2", np.full(9, 1e6), TERMS, FACE.T.ravel(), 0 * TERMS, np.tile([1.0, -1.0], 9)),)},
    "a clamp": {"fixed": held(TWO, TWO.position[:, 0] == 1).fixed},
}


@pytest.mark.parametrize("way", JOINED)
def test_merge_keeps_coincident_nodes_with_a_tie(way):
    mesh = replace(with_nodes(TWO, [5, 0, 0]) if "both" in way else TWO, **JOINED[way])
    assert connectivity_warnings(mesh) == ()
    kept = merged(mesh, 1e-6)
    assert len(kept.position) == len(mesh.position)
    assert "coincident nodes stay separate, because a tie, equation or spring connects them" in kept.notes[-1]


def test_average_over_both_sides_does_not_connect_them():
    mesh = with_nodes(TWO, [5, 0, 0])
    mesh = replace(mesh, averaging=(AveragingElement(1, 54, FACE.ravel(), np.ones(18), (0, 1, 2)),))
    assert connectivity_warnings(mesh)[0].startswith("18 nodes")
    joined = merged(mesh, 1e-6).averaging[0]
    assert len(joined.nodes) == 9
    assert (joined.weight == 2).all()


def test_a_merged_bar_bends_as_one_of_one_mesh_does():
    bends = []
    for mesh in (box(counts=(4, 2, 2), size=(2, 1, 1)), merged(TWO, 1e-6)):
        force = np.zeros((len(mesh.position), 3))
        force[mesh.position[:, 0] == 0] = [0, 0, 1e3]
        u = moved(held(mesh, mesh.position[:, 0] == 2), force).reshape(-1, 3)
        bends.append(u[mesh.position[:, 0] == 0, 2].mean())
    assert bends[1] == pytest.approx(bends[0], rel=1e-11)


def test_merge_replaces_references_to_merged_nodes():
    a, b = FACE
    far = int(np.flatnonzero(TWO.position[:, 0] == 2)[0])
    mesh = held(TWO, np.isin(np.arange(54), b))
    mesh = replace(
        mesh,
        node_sets={"seam": mesh.node_ids[b], "end": mesh.node_ids[[far]]},
        rigid=(RigidElement(1, far, b[:2], (0, 1, 2)),),
    )
    own = merged(mesh, 1e-6)
    assert own.node_sets["seam"].tolist() == sorted(mesh.node_ids[a].tolist())
    assert own.node_ids[own.rigid[0].reference] == mesh.node_ids[far]
    np.testing.assert_allclose(np.unique(own.position[own.fixed[:, 0], 0]), [1.0])
    assert own.node_ids[own.rigid[0].nodes].tolist() == sorted(mesh.node_ids[a[:2]].tolist())
    assert "9 nodes were merged into others within 1e-06 m" in own.notes[-1]


def test_merge_distance_that_collapses_an_element_is_refused():
    with pytest.raises(UserError, match=r"would lose a node: two of its nodes are 0\.5 m apart"):
        merged(TWO, 0.6)


def test_merge_refuses_different_coordinate_systems():
    turned = replace(TWO, axes={int(FACE[1, 3]): np.eye(3)[:, [1, 2, 0]]})
    with pytest.raises(DeckError, match="different local coordinate systems"):
        merged(turned, 1e-6)


@pytest.mark.parametrize("kind", ["tet4", "hex8", "hex20"])
def test_the_same_mesh_twice_in_one_place_is_an_error(kind):
    own = box(kind)
    with pytest.raises(
        DeckError, match=rf"elements 1 and {len(own.blocks[0].ids) + 1} \({kind}\) coincide"
    ) as caught:
        check_doubled(both(own, own))
    assert "remove one" in caught.value.remedy


def test_coincident_shells_are_refused_except_layers():
    part = ((2, 2), (1.0, 1.0), (0, 0, 0))
    mesh = plates(part, part)
    with pytest.raises(DeckError, match="quad4"):
        check_doubled(replace(mesh, shells=(joined_shells(*mesh.shells),)))
    up = replace(mesh.shells[1], offset=np.full(4, 0.01))
    check_doubled(replace(mesh, shells=(joined_shells(mesh.shells[0], up),)))


def test_coincident_shells_tied_at_corners_give_a_warning():
    part = ((4, 4), (1.0, 1.0), (0, 0, 0))
    mesh = plates(part, part)
    mesh = replace(mesh, shells=(joined_shells(*mesh.shells),))
    fasteners = tuple(RigidElement(i, k, np.array([k + 25]), tuple(range(6))) for i, k in enumerate((0, 4, 20, 24)))
    check_doubled(replace(mesh, rigid=fasteners))
    said = connectivity_warnings(replace(mesh, rigid=fasteners))
    assert "coincide but have separate nodes (12 coincident pairs in total); their parts are connected at other nodes" in said[1]
    with pytest.raises(DeckError, match="coincide"):
        check_doubled(held(mesh, mesh.position[:, 0] == 0))


def joined_shells(*blocks):
    names = ("ids", "nodes", "region", "offset", "axis")
    return ShellBlock("quad4", *(np.concatenate([getattr(b, name) for b in blocks]) for name in names))


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20"])
def test_nonmatching_meshes_have_hanging_nodes(kind):
    mesh = both(box(kind, (1, 1, 1)), box(kind, (2, 2, 2), at=(1, 0, 0)))
    found = {text.split(" nodes ")[1][:40]: int(text.split()[0]) for text in connectivity_warnings(mesh)}
    on_face = np.unique(mesh.position[mesh.nodes_of_elements][mesh.position[mesh.nodes_of_elements][:, 0] == 1], axis=0)
    coarse = box(kind, (1, 1, 1)).position
    at_coarse = len(coarse[coarse[:, 0] == 1])
    (shared, hanging) = found.values()
    assert shared == 2 * at_coarse
    assert hanging == len(on_face) - at_coarse


def test_hanging_nodes_on_shell_edge_and_beam():
    two = plates(((1, 1), (1.0, 1.0), (0, 0, 0)), ((2, 2), (1.0, 1.0), (1, 0, 0)))
    unmerged, hanging = connectivity_warnings(two)
    assert unmerged.startswith("4 nodes")
    assert hanging.startswith("a node lies on the surface of an element without belonging to it")
    assert "on element 1 at (1, 0.5, 0)" in hanging
    (left,) = connectivity_warnings(merged(two, 1e-6))
    assert left.startswith("a node lies")
    skin = plates(((2, 1), (1.0, 1.0), (0, 0, 0)))
    free = np.zeros((1, 2, 6), bool)
    beam = BeamBlock("beam", np.array([9]), np.array([[0, 4]]), np.array([2]), np.eye(3)[None], np.zeros((1, 2, 3)), free)
    (said,) = connectivity_warnings(replace(skin, beams=(beam,)))
    assert "node lies" in said
    assert "3 on element 9" in said
    assert connectivity_warnings(skin) == ()


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8"])
def test_overlapping_volumes_are_detected(kind):
    for other in (
        box("hex8", (3, 3, 3), at=(0.31, 0.27, 0.4)),
        box("tet10", (1, 1, 1), (0.4, 0.4, 0.4), (0.27, 0.31, 0.33)),
    ):
        (said,) = connectivity_warnings(both(box(kind, (2, 2, 2)), other))
        assert "stiffness and mass of overlapping volumes count twice" in said


def test_a_cross_of_two_bars_overlaps_without_a_node_of_one_in_the_other():
    mesh = both(box(counts=(3, 1, 1), size=(3, 1, 1)), box(counts=(1, 3, 1), size=(0.6, 3, 0.6), at=(1.2, -1, 0.2)))
    assert any("overlapping volumes" in said for said in connectivity_warnings(mesh))


def test_facets_in_a_joint_that_is_not_merged_or_does_not_fit_carry_no_gauge():
    for mesh in (TWO, both(box(counts=(1, 1, 1)), box("tet4", at=(1, 0, 0)))):
        facets = exterior_facets(mesh)
        lie = covered(mesh, facets)
        inside = [(mesh.position[own[own >= 0], 0] == 1).all() for own in facets.nodes]
        assert lie.tolist() == inside


def test_solids_sharing_an_edge_are_hinged_unless_tied():
    pair = body("hex8", (2, 2, 1), lambda x, y, z: (x, y, z), keep=lambda i, j, k: i == j)
    pair = held(pair, (pair.position[:, 0] == 0) | (pair.position[:, 0] == 2))
    (said,) = hinge_warnings(pair)
    edge = pair.node_ids[(pair.position[:, :2] == 1).all(axis=1)]
    assert f"nodes {edge[0]}, {edge[1]} and are hinged" in said
    ends = [int(np.flatnonzero((pair.position[:, :2] == at).all(axis=1))[0]) for at in ((1, 0), (2, 1))]
    tied = replace(pair, rigid=(RigidElement(1, ends[0], np.array(ends[1:]), (0, 1, 2)),))
    assert hinge_warnings(tied) == ()
