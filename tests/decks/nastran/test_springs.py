"""Springs, relations (MPC) and parameters of Nastran decks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.errors import DeckError, UserError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.equations import rotation_rows
from strainsight.fem.model import build_model
from strainsight.fem.springs import spring_operator
from strainsight.mesh.sanity import sanity_warnings

from ...refusals import refusal_table
from ..conftest import TETRAHEDRON
from ..programs import frequencies

"""Two masses along x, m = 2 and 3 kg, k = 100 N/m between them, 50 N/m from the second to the ground."""


def matrix(mesh):
    """K of the springs on the six motions of nodes 50 and 51, which lead ties."""
    rows = rotation_rows(mesh)
    nodes = [mesh.node_index(number) for number in (50, 51)]
    at = [first + c for first in (*(3 * node for node in nodes), *(rows[node] for node in nodes)) for c in range(3)]
    return spring_operator(mesh, rows).constant.toarray()[np.ix_(at, at)]


TIED = "GRID,50,,2.,0.,0.\nGRID,51,,2.,0.,3.\nRBE2,80,50,123,2\nRBE2,81,51,123,3\n"


@pytest.mark.parametrize(
    ("card", "axes"),
    [
        ("CBUSH,60,7,50,51,,,,0", np.eye(3)),
        ("CBUSH,60,7,50,51,0.,1.,0.", [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        ("CBUSH,60,7,50,51,1", [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    ],
)
def test_cbush_energy_equals_sum_of_springs(read, tetrahedron, card, axes):
    """½ Σ k s² for any motions, s between the motions of the two rigid arms that meet in the middle; rows of axes: x, y, z;
    of the last card y points to node 1 at the origin."""
    k = [3.0, 5, 7, 11, 13, 17]
    property_ = "PBUSH,7,K," + ",".join(map(str, k)) + "\n"
    axes, K = np.asarray(axes, float), matrix(read(f"{tetrahedron}{TIED}{card}\n{property_}ENDDATA\n"))
    rng = np.random.default_rng(0)
    uA, uB, tA, tB = rng.normal(size=(4, 3))
    apart = (uB + np.cross(tB, [0, 0, -1.5])) - (uA + np.cross(tA, [0, 0, 1.5]))
    s = np.concatenate([axes @ apart, axes @ (tB - tA)])
    z = np.concatenate([uA, uB, tA, tB])
    assert z @ K @ z == pytest.approx(np.sum(k * s**2))
    rigid = np.concatenate([uA, uA + np.cross(tA, [0, 0, 3.0]), tA, tA])
    np.testing.assert_allclose(K @ rigid, 0, atol=1e-12)


STIFFNESS = [3e5, 1e5, 5e4, 20.0, 30.0, 40.0]
PLACES = np.array([[1.0, 0, 0], [1.3, -0.3, 0.1]])
INERTIA = np.array([0.02, 0.03, 0.05])


def on_a_bush(held: str, k: list[float], bush: str, mass: str) -> str:
    return (
        "GRID,701,,1.,0.,0.\nGRID,702,,1.3,-.3,.1\nSPC1,1,123456,701\nSPC1,1,123,4\n"
        + (f"SPC1,1,{held},702\n" if held else "")
        + f"PBUSH,2,K,{','.join(map(str, k))}\n{bush}\n{mass}\nENDDATA\n"
    )


def frequencies_by_hand(held: str, k: list[float], S: float) -> np.ndarray:
    """√(eig(E diag(k) Eᵀ, M))/2π of the motions of 702 that are free, x from 701 to 702 and y towards (−1, 0, 0)."""
    along = np.diff(PLACES, axis=0)[0]
    x = along / np.linalg.norm(along)
    z = np.cross(x, [-1.0, 0, 0]) / np.linalg.norm(np.cross(x, [-1.0, 0, 0]))
    axes = np.array([x, np.cross(z, x), z])
    K, arm = np.zeros((6, 6)), (S - 1) * along
    for c in range(6):
        e = np.concatenate([axes[c], np.cross(arm, axes[c])]) if c < 3 else np.concatenate([np.zeros(3), axes[c - 3]])
        K += k[c] * np.outer(e, e)
    free = [c for c in range(6) if str(c + 1) not in held]
    M = np.diag([2.0, 2, 2, *INERTIA])[np.ix_(free, free)]
    return np.sqrt(eigh(K[np.ix_(free, free)], M, eigvals_only=True)) / (2 * np.pi)


LARGE = "".join(
    head.ljust(8) + "".join(field.rjust(16) for field in fields) + mark + "\n"
    for head, *fields, mark in (
        ("CBUSH*", "99", "2", "701", "702", "*"),
        ("*", "-1.", "0.", "0.", "", "*"),
        ("*", "{}", "", "0", "0", "*"),
        ("*", "0", ""),
    )
).replace("              {}", "{:>16}")


@pytest.mark.parametrize(
    ("held", "k", "bush", "S"),
    [
        ("456", STIFFNESS[:3] + [0.0] * 3, LARGE.format(""), 0.5),
        ("456", STIFFNESS[:3] + [0.0] * 3, "CBUSH,99,2,701,702,-1.,0.,0.\n+", 0.5),
        ("456", STIFFNESS, "CBUSH,99,2,701,702,-1.,0.,0.\n,.5,-1,0.,0.,0.", 0.5),
        ("", STIFFNESS, "CBUSH,99,2,701,702,-1.,0.,0.", 0.5),
        ("", STIFFNESS, "CBUSH,99,2,701,702,-1.,0.,0.\n,.2", 0.2),
        ("", STIFFNESS, LARGE.format("1."), 1.0),
        ("46", STIFFNESS, "CBUSH,99,2,701,702,-1.,0.,0.", 0.5),
        ("13456", [1e5, 2e5, 3e5, 0.0, 0.0, 0.0], "CBUSH,99,2,701,702,-1.,0.,0.", 0.5),
    ],
)
def test_mass_on_cbush_matches_analytic_frequency(read, tetrahedron, held, k, bush, S):
    mass = "CONM2,702,702,,2.\n,.02,,.03,,,.05"
    mesh, wanted = read(tetrahedron + on_a_bush(held, k, bush, mass)), frequencies_by_hand(held, k, S)
    assert build_model(mesh).size == len(wanted)
    np.testing.assert_allclose(frequencies(mesh, len(wanted)), wanted, rtol=1e-9)


def test_cbush_without_stiffness_gives_no_force(read, tetrahedron):
    """Torsion springs about y and z alone, along axes that are none of the node's: about x of the bush nothing turns."""
    k = [3e5, 1e5, 5e4, 0.0, 30.0, 40.0]
    text = on_a_bush("", k, "CBUSH,99,2,701,702,-1.,0.,0.\n,1.", "CONM2,702,702,,2.")
    np.testing.assert_allclose(frequencies(read(tetrahedron + text), 3), frequencies_by_hand("456", k, 1.0), rtol=1e-9)


def test_torsion_spring_acts_on_rotation(read, tetrahedron):
    """I φ'' = −k φ about y of CELAS2; the other motions are held."""
    text = on_a_bush("12346", [0.0] * 6, "CELAS2,99,7.,702,5", "CONM2,702,702,,2.\n,.02,,.03,,,.05")
    assert frequencies(read(tetrahedron + text), 1) == pytest.approx(np.sqrt(7 / 0.03) / (2 * np.pi), rel=1e-9)


def test_free_rotation_about_cbush_is_reported(read, tetrahedron):
    text = on_a_bush("", STIFFNESS[:3] + [0.0] * 3, "CBUSH,99,2,701,702,-1.,0.,0.", "CONM2,702,702,,2.")
    with pytest.raises(UserError, match=r"node 702, .* of a spring"):
        build_model(read(tetrahedron + text))


def test_spring_on_missing_rotation_is_refused_unless_fixed(read, tetrahedron):
    card = "CELAS2,99,7.,4,5\nSPC1,1,12,4\n"
    with pytest.raises(DeckError, match="CELAS2 99 acts on rotations of node 4, which has no rotations"):
        build_model(read(f"{tetrahedron}{card}ENDDATA\n"))
    held = build_model(read(f"{tetrahedron}{card}SPC1,1,456,4\nENDDATA\n"))
    without = build_model(read(f"{tetrahedron}SPC1,1,12,4\nENDDATA\n"))
    assert (held.stiffness.constant - without.stiffness.constant).nnz == 0


def test_spring_acts_along_nodal_axes(read, tetrahedron):
    system = "CORD2R,5,,0.,0.,0.,1.,0.,0.\n+,0.,1.,0.\n"  # its z is x, its x is y
    text = system + tetrahedron.replace("GRID,4,,0.,0.,1.", "GRID,4,,0.,0.,1.,5") + "CELAS2,60,9.,4,3\nENDDATA\n"
    (own,) = read(text).springs
    np.testing.assert_allclose(own.value, [1, 0, 0], atol=1e-15)
    assert own.component.tolist() == [0, 1, 2]


test_invalid_springs_are_refused = refusal_table(lambda cards: f"{TETRAHEDRON}{cards}ENDDATA\n", [
    ("CELAS1,60,7,4,3\n", "property 7 is not a PELAS of the deck"),
    ("CELAS2,60,9.,4,1,3,5\n", "the spring connects a translation with a rotation"),
    ("CELAS2,60,-9.,4,1\n", "negative"),
    ("CBUSH,60,7,4\nPBUSH,7,K,1.\n", "the ends coincide or one end is grounded, so the element axes are undefined"),
    ("CBUSH,60,7,4,3,,,,0\n+,1.2\nPBUSH,7,K,1.\n", "S is 1.2"),
    ("CBUSH,60,7,4,3,,,,0\n+,,5,1.\nPBUSH,7,K,1.\n", "OCID is not supported: it moves the spring away from the line between its"),
    ("CBUSH,60,7,4,3,,,,0\nPBUSH,7,K,1.\n+,,M,2.\n", r"mass \(M\) is not supported"),
], placed=False)


# MPC cards as relations, and which of them count.
def test_mpc_terms_are_read_in_all_field_formats(read, tetrahedron):
    free = "MPC,3,4,1,2.,2,3,-1.\n,,3,2,.5,1,6\n,,2,1,1.5-1\n"
    fixed = (
        "MPC            3       4       1      2.       2       3     -1.\n"
        "                       3       2      .5       1       6\n"
        "                       2       1     .15\n"
    )
    for card in (free, fixed):
        (own,) = read(tetrahedron + card).relations
        assert (own.id, str(own), own.follower) == (1, "MPC 3", (3, 0))
        assert own.node.tolist() == [3, 1, 2, 0, 1]
        assert own.component.tolist() == [0, 2, 1, 5, 0]
        assert own.value.tolist() == [2.0, -1.0, 0.5, 0.0, 0.15]


def test_mpc_components_are_along_nodal_axes(read, tetrahedron):
    """u_r of a cylindrical system at 45° is (u_x + u_y)/√2."""
    text = tetrahedron.replace("GRID,4,,0.,0.,1.", "CORD2C,6,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nGRID,4,,1.,1.,1.,6")
    mesh = read(f"{text}MPC,3,4,1,1.\n")
    T = constraint_transform(mesh).transform.toarray()
    assert T.shape[1] == 2
    np.testing.assert_allclose(T[9] + T[10], 0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(T[9:12], axis=0), 1)


test_relations_that_cannot_be_taken_are_named = refusal_table(
    lambda head, cards: f"{head}BEGIN BULK\n{TETRAHEDRON}{cards}\nENDDATA\n", [
    ("", "MPC,3,4,1,0.,2,3,-1.", "the coefficient of the first term is 0", 10),
    ("", "MPC,3,4,7,1.", "component 7", 10),
    ("", "MPC,3,4,1,1.,2,3,-1.,3\n,,2,1,.1", "found '3' in field 9, which must be blank", 10),
    ("", "MPC,3,4,1,1.\nMPC,5,4,2,1.", r"the deck has 2 MPC sets \(3, 5\), but no case control", 11),
    ("", "MPC,3,4,1,1.\nMPCADD,5,3,6", "MPCADD refers to set 6, which has no MPC card", 11),
    ("MPC = 4\n", "MPC,3,4,1,1.", "MPC = 4 selects an MPC set that is not in the deck", 1),
    ("SUBCASE 1\nMPC = 3\nSUBCASE 2\nMPC = 5\n", "MPC,3,4,1,1.\nMPC,5,4,2,1.", "different MPC sets .3, 5.", 4),
])


def test_moment_on_node_with_relation_is_applied(read, tetrahedron):
    cards = "GRID,9,,0.,0.,2.\nMPC,3,4,1,1.,9,5,-2.\nMOMENT,7,9,,1.,0.,1.,0.\n"
    mesh = read(tetrahedron + cards)
    assert not [note for note in mesh.notes if "without rotations" in note]
    T = constraint_transform(mesh)
    row = T.reference_rows[mesh.node_index(9)] + 1
    assert T.transform[[row]].nnz == 1
    assert T.transform[[9]].toarray().max() == pytest.approx(2.0)


# Every PARAM by its name: what counts or states the usual, what changes the structure and does not count, what has no effect.
@pytest.mark.parametrize(
    ("line", "effect"),
    [
        ("PARAM,POST,-1", {"PARAM POST": "none"}),
        ("PARAM,AUTOSPC,YES", {"PARAM AUTOSPC": "none"}),
        ("PARAM,LGDISP,1", {"PARAM LGDISP": "structure"}),
        ("PARAM,CM1,2.", {"PARAM CM1": "structure"}),
        ("PARAM,OWNNAME,3", {"PARAM OWNNAME": None}),
        ("PARAM,CM1,1.", {}),
        ("PARAM,LGDISP,0", {}),
        ("PARAM,WTMASS,.5", {}),
    ],
)
@pytest.mark.parametrize("control", [False, True])
def test_param_cards_are_listed_with_their_effect(read, tetrahedron, line, effect, control):
    places = (f"{line}\n", "") if control else ("", f"{line}\n")
    mesh = read(f"SOL 103\nCEND\nSPC = 1\n{places[0]}BEGIN BULK\n{tetrahedron}{places[1]}ENDDATA\n")
    assert {name: mesh.effect.get(name) for name in mesh.ignored} == effect


@pytest.mark.parametrize(
    ("value", "lumped"), [("-1", True), ("0", True), ("1", False), ("-1\nPARAM,COUPMASS,1", False)]
)
def test_coupmass_selects_lumped_mass(read, tetrahedron, value, lumped):
    mesh = read(f"{tetrahedron}PARAM,COUPMASS,{value}\nENDDATA\n")
    assert mesh.lumped == lumped
    assert not any("lumped" in text for text in sanity_warnings(mesh))


