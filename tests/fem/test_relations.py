"""Relations between motions and averages of them, against elimination, multipliers and pyYeti."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from pyyeti import nastran
from scipy.sparse.linalg import spsolve

from strainsight.decks.nastran.deck import read_nastran
from strainsight.errors import DeckError, UserError
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.equations import rotation_rows
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.support import require_support, rigid_body_motions
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement

from ..bodies import with_nodes
from .test_constraints import by_multipliers
from .test_thin import BAR, E, line


def relation(*terms, number=1):
    """Terms (node, component, value)."""
    node, component, value = zip(*terms, strict=True)
    return Relation(number, np.array(node), np.array(component), np.array(value, dtype=float), f"MPC {number}")


def turned(seed):
    """Axes, one in a column."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def test_relations_equal_lagrange_multipliers(box):
    axes = {4: turned(3), 6: turned(4)}
    mesh = replace(box("hex8", (2, 1, 1), clamp_root=True), axes=axes)
    rng = np.random.default_rng(5)
    terms = [[(4, 1), (5, 0), (6, 2), (7, 1)], [(7, 1), (11, 0), (6, 0)], [(8, 2), (4, 1), (9, 2)], [(10, 0), (10, 1)]]
    own = tuple(
        relation(*((n, c, v) for (n, c), v in zip(motions, rng.uniform(0.5, 2, len(motions)), strict=True)), number=i)
        for i, motions in enumerate(terms, 1)
    )
    held = set(map(tuple, mesh.fixed.tolist()))
    mesh = replace(mesh, fixed=np.array(sorted(held - {(n, c) for motions in terms for n, c in motions})), relations=own)
    n = 3 * len(mesh.position)
    K, f = assemble(mesh)[0].constant.toarray(), rng.standard_normal(n)
    T = constraint_transform(mesh).transform.toarray()
    found = T @ np.linalg.solve(T.T @ K @ T, T.T @ f)
    C = np.zeros((len(own) + len(mesh.fixed), n))
    for row, e in enumerate(own):
        for node, c, value in zip(e.node, e.component, e.value, strict=True):
            C[row, 3 * node : 3 * node + 3] += value * axes.get(node, np.eye(3))[:, c]
    for row, (node, c) in enumerate(mesh.fixed, len(own)):
        C[row, 3 * node : 3 * node + 3] = axes.get(node, np.eye(3))[:, c]
    expected = by_multipliers(K, C, f)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def two_cantilevers(a, b):
    """Clamped at both outer ends; nodes 2 and 4 at x = a are two."""
    mesh = with_nodes(line([[0, 0, 0], [a / 2, 0, 0], [a, 0, 0], [a + b, 0, 0]]), [a, 0, 0])
    block = replace(mesh.beams[0], nodes=np.array([[0, 1], [1, 2], [4, 3]]))
    return replace(mesh, beams=(block,), fixed=np.array([(node, c) for node in (0, 3) for c in range(6)]))


def deflection(mesh, node, component, force=1.0):
    model = build_model(mesh)
    direction = tuple(np.eye(3)[component])
    S = force * input_shape(model, [PointLoad("P", direction, node_id=int(mesh.node_ids[node]))])[:, 0]
    return nodal(model, spsolve(model.stiffness.constant.tocsc(), S)).reshape(-1, 3)


def test_a_gear_between_two_beams_turns_force_into_moment():
    """u_y of one tip is r θ_x of the other: a force P there is a moment r P, and k = 3EI/a³ + GJ/(b r²)."""
    a, b, r = 0.7, 0.4, 0.05
    mesh = replace(two_cantilevers(a, b), relations=(relation((2, 1, 1.0), (4, 3, -r)),))
    u = deflection(mesh, 2, 1, 10.0)
    EI, GJ = E * BAR.second[0, 0], E / 2.6 * BAR.torsion
    assert u[2, 1] == pytest.approx(10.0 / (3 * EI / a**3 + GJ / b / r**2), rel=1e-9)


STATICALLY = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def test_relations_to_the_ground_are_supports(box):
    mesh = box("hex8", (1, 1, 1))
    order = np.lexsort(mesh.position.T)  # origin, then along x, then along y
    held = tuple(relation((order[i], c, 3.0), number=k + 1) for k, (i, c) in enumerate(STATICALLY))
    for relations, words in ((held, ()), (held[1:], ("translation x",)), (held[:2] + held[3:], ("rotation about",))):
        own = replace(mesh, relations=relations)
        found = rigid_body_motions(own, constraint_transform(own))
        assert len(found) == len(words)
        assert all(word in motion for word, motion in zip(words, found, strict=True))
    assert build_model(replace(mesh, relations=held)).size == 18


def test_relation_that_violates_rigid_motion_constrains_it(box):
    """u_x of one node twice that of another: translation x is none any more, a rotation about a point at −1 of both is."""
    mesh = box("hex8", (1, 1, 1))
    free = rigid_body_motions(mesh, constraint_transform(mesh))
    own = replace(mesh, relations=(relation((0, 0, 1.0), (7, 0, -2.0)),))
    found = rigid_body_motions(own, constraint_transform(own))
    assert (len(free), len(found)) == (6, 5)
    assert "translation x" not in found
    assert {"translation y", "translation z"} <= set(found)


def test_relation_on_motions_without_stiffness_is_reported(box):
    mesh = with_nodes(box("hex8", (1, 1, 1), clamp_root=True), [2.0, 0.0, 0.0], ids=[900])
    mesh = replace(mesh, relations=(relation((7, 0, 1.0), (8, 0, -1.0), (8, 4, -0.3)),))
    with pytest.raises(UserError, match=r"node 900, translation x of a constraint equation \(MPC\), node 900, rot"):
        require_support(mesh, constraint_transform(mesh))


@pytest.mark.parametrize(
    ("relations", "what", "number"),
    [
        ([[(7, 0, 1), (6, 0, -1)], [(7, 0, 1), (5, 0, 1)]], "node 8 is dependent in MPC 1 and in MPC 2", 2),
        ([[(0, 2, 1), (6, 0, -1)]], "component 3 of node 1 is clamped, but also dependent in MPC 1", 1),
        ([[(7, 0, 1), (6, 1, -1)], [(6, 1, 1), (7, 0, 1)]], "ties form a cycle through nodes 7, 8", 1),
        ([[(7, 0, 0), (6, 0, -1)]], "the first term of MPC 1, component 1 of node 8, has the coefficient 0", 1),
        ([[(7, 0, 1), (6, 0, 1), (7, 0, -1)]], "the first term of MPC 1, component 1 of node 8, has the coefficient 0", 1),
    ],
)
def test_conflicting_relations_are_refused(box, relations, what, number):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    assert (mesh.position[[5, 6, 7], 0] == 1).all()
    own = tuple(relation(*terms, number=i) for i, terms in enumerate(relations, 1))
    with pytest.raises(DeckError, match=what) as caught:
        constraint_transform(replace(mesh, relations=own))
    assert caught.value.entity[0] == "relation"
    assert caught.value.entity[1] == number or "cycle" in what
    assert caught.value.remedy


def test_a_rigid_element_and_a_relation_may_not_both_lead(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    mesh = replace(mesh, rigid=(RigidElement(3, 7, np.array([6]), (0, 1, 2), "RBE2 3"),))
    with pytest.raises(DeckError, match="node 7 is dependent in RBE2 3 and in MPC 1"):
        constraint_transform(replace(mesh, relations=(relation((6, 1, 1), (5, 1, 1)),)))
    # as its reference the node may follow, and the chain is resolved
    T = constraint_transform(replace(mesh, relations=(relation((7, 1, 1), (5, 1, -2)),))).transform.toarray()
    np.testing.assert_allclose(T[3 * 7 + 1], 2 * T[3 * 5 + 1])


def test_a_rotation_with_the_coefficient_zero_is_none(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    mesh = replace(mesh, relations=(relation((7, 0, 1.0), (6, 4, 0.0), (6, 0, -1.0)),))
    assert rotation_rows(mesh) == {}
    assert build_model(mesh).size == 11


SOLID = """\
CORD2C,6,,.3,.2,.1,.3,.2,1.
+,1.,.4,.1
CORD2R,7,,.0,.1,.2,.3,.4,1.
+,1.,.4,.1
GRID,1,,0.,0.,0.{0}
GRID,2,,1.,0.,0.{1}
GRID,3,,0.,1.,0.{0}
GRID,4,,0.,0.,1.{1}
GRID,5,,1.,1.,1.1{0}
GRID,9,,.2,.3,.7{2}
"""
ELEMENTS = "CTETRA,10,1,1,2,3,4\nCTETRA,11,1,2,3,4,5\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7850.\n"
SYSTEMS = [("", "", ""), (",6", ",7", ""), (",7", ",6", ",6"), ("", "", ",7")]
CASES = {  # RBE3 fields from REFC on
    "equal weights": "123456 1. 123 1 2 3 4",
    "weights": "12346 1. 123 1 2 .3 123 3 5",
    "single directions": "135 1. 12 1 2 3 4 .3 3 1 3 5 4",
    "UM among the nodes": "123456 1. 123 1 2 3 4 5 UM 1 123 2 23 3 3",
    "UM of both": "123456 1. 123 1 2 3 4 UM 9 456 4 123",
    "UM of the reference": "246 1. 123 1 2 3 4 UM 9 246",
    "rotations": "123456 1. 123456 1 2 .3 123 3 5",
    "rotations of their own weight": "123456 1. 123 1 2 3 5 .3 45 1 4",
    "UM among rotations": "12346 1. 123456 1 2 .3 1234 3 5 UM 1 123 2 2 3 4",
}
BEAMS = "CBAR,20,2,1,2,.3,.4,.5\nCBAR,21,2,3,4,.3,.4,.5\nCBAR,22,2,5,4,.3,.4,.5\nPBAR,2,1,.1,.2,.2,.1\n"
"""What turns the nodes of the solids."""


def lines_of(fields):
    """A card in free format, eight fields a line."""
    return "".join(
        ("RBE3" if i == 0 else "+") + "," + ",".join(fields[i : i + 8]) + "\n" for i in range(0, len(fields), 8)
    )


def digits(number):
    return [int(digit) - 1 for digit in str(number)]


def as_of_pyyeti(fields):
    """Components, groups of [components, weight], nodes, and UM set."""
    words, _, um = fields.partition(" UM ")
    components, *words = words.split()
    starts = [i for i, word in enumerate(words) if "." in word]
    parts = [words[i:j] for i, j in zip(starts, [*starts[1:], None], strict=True)]
    groups = [own for weight, c, *nodes in parts for own in ([int(c), float(weight)], [int(node) for node in nodes])]
    return int(components), groups, [int(word) for word in um.split()] or None


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize("case", CASES)
def test_averaging_agrees_with_pyyeti(tmp_path, case, systems):
    fields = CASES[case]
    components, groups, um = as_of_pyyeti(fields)
    grids = SOLID.format(*systems)
    (tmp_path / "deck.bdf").write_text(grids + ELEMENTS + BEAMS + lines_of(["90", "", "9", *fields.split()]) + "ENDDATA\n")
    mesh = read_nastran(tmp_path / "deck.bdf")
    uset, _ = nastran.bulk2uset(io.StringIO(grids))
    expected = nastran.formrbe3(uset, 9, components, groups, um)
    used = {(int(mesh.node_index(9)), c) for c in digits(components)}
    for (parts, _), nodes in zip(groups[::2], groups[1::2], strict=True):
        used |= {(mesh.node_index(i), c) for i in nodes for c in digits(parts)}
    dependent = {(mesh.node_index(i), c) for i, parts in zip(um[::2], um[1::2], strict=True) for c in digits(parts)} if um else {
        (mesh.node_index(9), c) for c in digits(components)
    }  # fmt: skip
    assert expected.shape == (len(dependent), len(used - dependent))

    constraint = constraint_transform(mesh)

    def rows(pairs):
        return [3 * node + c if c < 3 else constraint.reference_rows[node] + c - 3 for node, c in sorted(pairs)]

    own = constraint.transform.toarray()
    for node, axes in mesh.axes.items():
        for row in (3 * node, constraint.reference_rows.get(node)):
            if row is not None:
                own[row : row + 3] = axes.T @ own[row : row + 3]
    found, source = own[rows(dependent)], own[rows(used - dependent)]
    np.testing.assert_allclose(found, expected @ source, atol=1e-12)
    # and the motions that lead are free
    assert np.linalg.matrix_rank(source) == len(used - dependent)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_a_um_set_leaves_the_same_motions_free(box, unit):
    """T spans all z with u_r = mean: the same motions as with the reference dependent, other coordinates."""
    mesh = box("hex8", (1, 1, 1), size=(unit, unit, unit))
    tip = np.flatnonzero(mesh.position[:, 0] > unit / 2)
    mesh = with_nodes(mesh, unit * np.array([1.2, 0.4, 0.7]), ids=[900])
    e = AveragingElement(3, 8, tip, np.array([1.0, 2.0, 0.5, 1.5]), tuple(range(6)))
    um = np.array([(tip[0], 0), (tip[0], 1), (tip[0], 2), (tip[1], 0), (tip[1], 1), (tip[2], 0)])
    lengths = np.ones(27 + 3)
    lengths[27:] = unit
    spaces = []
    for dependent in (None, um):
        T = constraint_transform(replace(mesh, averaging=(replace(e, dependent=dependent),))).transform.toarray()
        assert T.shape[1] == 24
        spaces.append(np.linalg.qr(T * lengths[:, None])[0])
    assert np.linalg.svd(spaces[0].T @ spaces[1])[1].min() > 1 - 1e-10


def refused(mesh, what, **change):
    e = AveragingElement(3, 8, np.arange(4), np.ones(4), (0, 1, 2), **change)
    with pytest.raises(DeckError, match=what) as caught:
        constraint_transform(replace(mesh, averaging=(e,)))
    assert caught.value.entity == ("tie", 3)
    assert caught.value.remedy


def test_um_sets_that_do_not_determine_the_equations_are_refused(box):
    mesh = box("hex8", (1, 1, 1))
    mesh = with_nodes(mesh, [0.5, 0.5, 0.5], ids=[900])
    named = "the equations of averaging element 3 cannot be solved for its dependent motions"
    refused(mesh, f"{named} .UM: node 1 component 2, 2 component 2, 3 component 2", dependent=[(0, 1), (1, 1), (2, 1)])
    refused(mesh, named, dependent=[(0, 0), (0, 0), (0, 1)])
    refused(mesh, named, dependent=[(0, 0), (7, 1), (0, 2)])
    refused(mesh, named, dependent=[(0, 0), (0, 1)])
    only_x = np.array([[True, False, False]] * 4)
    refused(mesh, "do not determine the translation y", directions=only_x)
