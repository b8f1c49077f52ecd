"""RBE3 in all its forms against another program's, and UM sets against the null space of the equations."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from pyyeti import nastran
from scipy.linalg import null_space

from strainsight.decks.nastran.deck import read_nastran
from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform
from strainsight.mesh.joins import AveragingElement

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
# RBE3 fields from REFC on, and the same for pyyeti: components, groups, UM set
CASES = {
    "equal weights": ("123456 1. 123 1 2 3 4", 123456, [[123, 1.0], [1, 2, 3, 4]], None),
    "weights": ("12346 1. 123 1 2 .3 123 3 5", 12346, [[123, 1.0], [1, 2], [123, 0.3], [3, 5]], None),
    "single directions": (
        "135 1. 12 1 2 3 4 .3 3 1 3 5 4",
        135,
        [[12, 1.0], [1, 2, 3, 4], [3, 0.3], [1, 3, 5, 4]],
        None,
    ),
    "UM among the nodes": (
        "123456 1. 123 1 2 3 4 5 UM 1 123 2 23 3 3",
        123456,
        [[123, 1.0], [1, 2, 3, 4, 5]],
        [1, 123, 2, 23, 3, 3],
    ),
    "UM of both": ("123456 1. 123 1 2 3 4 UM 9 456 4 123", 123456, [[123, 1.0], [1, 2, 3, 4]], [9, 456, 4, 123]),
    "UM of the reference": ("246 1. 123 1 2 3 4 UM 9 246", 246, [[123, 1.0], [1, 2, 3, 4]], [9, 246]),
    "rotations": ("123456 1. 123456 1 2 .3 123 3 5", 123456, [[123456, 1.0], [1, 2], [123, 0.3], [3, 5]], None),
    "rotations of their own weight": (
        "123456 1. 123 1 2 3 5 .3 45 1 4",
        123456,
        [[123, 1.0], [1, 2, 3, 5], [45, 0.3], [1, 4]],
        None,
    ),
    "UM among rotations": (
        "12346 1. 123456 1 2 .3 1234 3 5 UM 1 123 2 2 3 4",
        12346,
        [[123456, 1.0], [1, 2], [1234, 0.3], [3, 5]],
        [1, 123, 2, 2, 3, 4],
    ),
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


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize("case", CASES)
def test_averaging_is_what_pyyeti_makes_of_it(tmp_path, case, systems):
    fields, components, groups, um = CASES[case]
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
def test_a_um_set_leaves_the_null_space_of_the_equations(box, unit):
    """T spans all z with u_r = mean: the same motions as with the reference dependent, other coordinates."""
    mesh = box("hex8", (1, 1, 1), size=(unit, unit, unit))
    tip = np.flatnonzero(mesh.position[:, 0] > unit / 2)
    mesh = replace(
        mesh,
        node_ids=np.append(mesh.node_ids, 900),
        position=np.vstack([mesh.position, unit * np.array([1.2, 0.4, 0.7])]),
    )
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
    # and that space is what the normal equations of the weighted fit annul
    arm = mesh.position[tip] - mesh.position[8]
    design = np.vstack([np.hstack([np.eye(3), np.column_stack([np.cross(a, r) for a in np.eye(3)])]) for r in arm])
    normal = design.T * np.repeat(e.weight, 3)
    C = np.zeros((6, 30))
    C[:, (3 * tip[:, None] + np.arange(3)).ravel()] = normal
    C[:, 24:30] = -normal @ design
    C = C / np.array([1, 1, 1, unit, unit, unit])[:, None] / lengths
    assert np.linalg.svd(null_space(C).T @ spaces[1])[1].min() > 1 - 1e-10


def refused(mesh, what, **change):
    e = AveragingElement(3, 8, np.arange(4), np.ones(4), (0, 1, 2), **change)
    with pytest.raises(DeckError, match=what) as caught:
        constraint_transform(replace(mesh, averaging=(e,)))
    assert caught.value.entity == ("tie", 3)
    assert caught.value.remedy


def test_um_sets_that_do_not_determine_the_equations_are_refused(box):
    mesh = box("hex8", (1, 1, 1))
    mesh = replace(mesh, node_ids=np.append(mesh.node_ids, 900), position=np.vstack([mesh.position, [0.5, 0.5, 0.5]]))
    named = "averaging element 3 cannot be solved for the motions that it states as dependent"
    refused(mesh, f"{named} .node 1 component 2, 2 component 2, 3 component 2", dependent=[(0, 1), (1, 1), (2, 1)])
    refused(mesh, named, dependent=[(0, 0), (0, 0), (0, 1)])
    refused(mesh, named, dependent=[(0, 0), (7, 1), (0, 2)])
    refused(mesh, named, dependent=[(0, 0), (0, 1)])
    only_x = np.array([[True, False, False]] * 4)
    refused(mesh, "do not hold translation y", directions=only_x)
