"""Static loads of a deck by their resultant and moment, which statics knows without any mesh."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError

from ...solids import SOLIDS

RHO_G = 9810.0


def facets(kind):
    """Corners of the facets of a convex solid, each in the sense whose normal points outward, by its planes alone."""
    x = SOLIDS[kind].points(())[: len(SOLIDS[kind].corners)]
    middle, found = x.mean(axis=0), {}
    for a in range(len(x)):
        for b in range(len(x)):
            for c in range(len(x)):
                n = np.cross(x[b] - x[a], x[c] - x[a])
                height = (x - x[a]) @ n
                if np.linalg.norm(n) > 0 and np.all(height < 1e-12):
                    on = np.flatnonzero(np.abs(height) < 1e-12)
                    centre = x[on].mean(axis=0)
                    e = x[on[0]] - centre
                    angle = np.arctan2((x[on] - centre) @ np.cross(n / np.linalg.norm(n), e), (x[on] - centre) @ e)
                    found[frozenset(on.tolist())] = on[np.argsort(angle)].tolist()
    assert all(np.dot(np.cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]]), x[f[0]] - middle) > 0 for f in found.values())
    return list(found.values())


def volume_and_centre(kind):
    """By tetrahedra from the middle to each facet."""
    x = SOLIDS[kind].points(())
    top, parts = x.mean(axis=0), []
    for f in facets(kind):
        for i in range(1, len(f) - 1):
            corners = np.array([top, x[f[0]], x[f[i]], x[f[i + 1]]])
            parts.append((abs(np.linalg.det(corners[1:] - corners[0])) / 6, corners.mean(axis=0)))
    volume = sum(v for v, _ in parts)
    return volume, sum(v * c for v, c in parts) / volume


def deck(kind, loads):
    solid = SOLIDS[kind]
    x = solid.points(solid.nastran_edges)
    fields = ["7", "1", *(str(i + 1) for i in range(len(x)))]
    element = "\n+,".join(",".join(fields[i : i + 8]) for i in range(0, len(fields), 8))
    grids = "".join(f"GRID,{i + 1},,{a!r},{b!r},{c!r}\n" for i, (a, b, c) in enumerate(x.tolist()))
    return f"{grids}{solid.nastran},{element}\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7850.\n{loads}ENDDATA\n"


def totals(mesh, name):
    load = mesh.loads[name]
    x = mesh.position[load.nodes]
    moment = np.zeros(3) if load.moment is None else load.moment.sum(axis=0)
    return load.force.sum(axis=0), np.cross(x, load.force).sum(axis=0) + moment


def as_a_card_names_it(facet, corners, turn):
    """The corners of a facet of a solid of so many corners, G1 first, and G3 or G4; turn: which of the possible ones."""
    if len(facet) == 3 and corners == 5:  # a pyramid, of which an edge on the base is named
        base = [i for i in facet if i < 4]
        start, other = base[turn], base[1 - turn]
    else:
        start = facet[turn]
        opposite = facet[(turn + 2) % 4] if len(facet) == 4 else None
        other = next(iter(set(range(4)) - set(facet))) if corners == 4 else opposite
    at = facet.index(start)
    return [*facet[at:], *facet[:at]], other


@pytest.mark.parametrize("kind", list(SOLIDS))
@pytest.mark.parametrize("turn", [0, 1])
def test_a_body_under_water_is_lifted_by_the_water_it_displaces(read, kind, turn):
    """PLOAD4 on every face, ρg(2 − z) at its corners: Archimedes, ρgV at the centre of the volume, whatever corner is G1."""
    x, cards = SOLIDS[kind].points(()), ""
    for facet in facets(kind):
        f, other = as_a_card_names_it(facet, len(x), turn)
        p = [f"{RHO_G * (2 - x[i, 2]):.9e}" for i in f] + [""] * (4 - len(f))
        cards += f"PLOAD4,3,7,{','.join(p)},{f[0] + 1},{'' if other is None else other + 1}\n"
    force, moment = totals(read(deck(kind, cards)), "LOAD-3")
    volume, centre = volume_and_centre(kind)
    np.testing.assert_allclose(force, [0, 0, RHO_G * volume], atol=1e-9 * RHO_G)
    np.testing.assert_allclose(moment, np.cross(centre, force), atol=1e-9 * RHO_G)


def test_a_pressure_with_a_vector_acts_along_it(read):
    """In a cylinder about z through the middle of the face: e_θ by the right-hand rule, ∫ e_θ dA turns and does not push."""
    base = deck("hex8", "CORD2C,6,,.5,.625,0.,.5,.625,1.\n+,2.,.625,0.\nPLOAD4,1,7,3.,,,,5,7\n+,,0.,-2.,0.\n"
                "PLOAD4,2,7,3.,,,,5,7\n+,6,0.,1.,0.\n")
    mesh = read(base)
    force, _ = totals(mesh, "LOAD-1")
    np.testing.assert_allclose(force, [0, -3 * 1.25, 0], atol=1e-12)
    force, _ = totals(mesh, "LOAD-2")
    load = mesh.loads["LOAD-2"]
    turn = np.cross(mesh.position[load.nodes] - [0.5, 0.625, 1.5], load.force).sum(axis=0)
    np.testing.assert_allclose(force, 0, atol=1e-12)
    assert turn[2] > 0
    np.testing.assert_allclose(turn[:2], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("cards", "sign"),
    [
        ("PLOAD,1,2.,5,6,7,8\n", 1),
        ("PLOAD,1,2.,8,7,6,5\n", -1),
        ("CQUAD4,40,9,5,6,7,8\nPLOAD2,1,2.,40\n", 1),
        ("CQUAD4,40,9,8,7,6,5\nPLOAD2,1,2.,40\n", -1),
        ("CQUAD4,40,9,6,7,8,5\nCQUAD4,41,9,1,2,3,4\nPLOAD4,1,40,2.,,,,THRU,40\n", 1),
    ],
)
def test_pressure_by_nodes_or_on_a_plate_follows_the_right_hand_rule(read, cards, sign):
    """The sequence 5, 6, 7, 8 on the top of the solid has its normal upward."""
    force, moment = totals(read(deck("hex8", cards), ignore=["CQUAD4"]), "LOAD-1")
    np.testing.assert_allclose(force, [0, 0, sign * 2 * 1.25], atol=1e-12)
    np.testing.assert_allclose(moment, np.cross([0.5, 0.625, 1.5], force), atol=1e-12)


def test_a_pressure_on_a_plate_varies_as_its_corners_say(read):
    """p = 1, 2, 2, 1 at nodes 6, 7, 8, 5 grows along y: resultant by the mean, moment by ∫ p y dA = 5/9 of F b."""
    cards = "CQUAD4,40,9,6,7,8,5\nPLOAD4,1,40,1.,2.,2.,1.\n"
    force, moment = totals(read(deck("hex8", cards), ignore=["CQUAD4"]), "LOAD-1")
    np.testing.assert_allclose(force, [0, 0, 1.5 * 1.25], atol=1e-15)
    assert moment[0] == pytest.approx(5 / 9 * 1.25 * force[2])


def test_forces_and_moments_by_nodes(read):
    cards = "FORCE1,1,1,4.,1,3\nFORCE2,2,1,4.,1,2,1,4\nMOMENT,3,2,,2.,0.,3.,0.\nMOMENT1,4,2,5.,1,5\nMOMENT2,5,2,5.,1,2,1,4\n"
    mesh = read(deck("hex8", cards))
    along = np.array([1, 1.25, 0]) / np.hypot(1, 1.25)
    for name, force, moment in (
        ("LOAD-1", 4 * along, [0, 0, 0]),
        ("LOAD-2", [0, 0, 4], [0, 0, 0]),
        ("LOAD-3", [0, 0, 0], [0, 6, 0]),
        ("LOAD-4", [0, 0, 0], [0, 0, 5]),
        ("LOAD-5", [0, 0, 0], [0, 0, 5]),
    ):
        np.testing.assert_allclose(totals(mesh, name)[0], force, atol=1e-14)
        np.testing.assert_allclose(totals(mesh, name)[1], moment, atol=1e-14)
    (note,) = (note for note in mesh.notes if "MOMENT" in note)
    assert note.startswith("MOMENT on node 2 without rotations")


def test_a_combination_adds_its_sets_with_their_factors(read):
    cards = "FORCE,1,2,,1.,1.\nFORCE,2,2,,1.,,1.\nMOMENT,2,3,,1.,,,1.\nGRAV,3,,9.81,,,-1.\nLOAD,9,2.,3.,1,.5,2,4.,3\n"
    mesh = read(deck("hex8", cards))
    assert list(mesh.loads) == ["FORCE-1", "LOAD-2", "LOAD-3", "LOAD-9"]
    load = mesh.loads["LOAD-9"]
    np.testing.assert_allclose(load.force, [[6, 1, 0], [0, 0, 0]])
    np.testing.assert_allclose(load.moment, [[0, 0, 0], [0, 0, 1]])
    (body,) = load.body
    assert body.factor == 8
    np.testing.assert_allclose(body.acceleration, [0, 0, -9.81])


def test_weight_and_rotation_are_read_in_their_systems(read):
    cards = "CORD2R,7,,1.,2.,3.,2.,2.,3.\n+,1.,3.,3.\nGRAV,1,7,2.,0.,0.,3.\nRFORCE,2,3,7,.5,0.,0.,2.\n"
    mesh = read(deck("hex8", cards))
    (weight,), (spin,) = mesh.loads["LOAD-1"].body, mesh.loads["LOAD-2"].body
    np.testing.assert_allclose(weight.acceleration, [6, 0, 0], atol=1e-14)
    np.testing.assert_allclose(spin.rotation, [2 * np.pi, 0, 0], atol=1e-14)
    np.testing.assert_allclose(spin.centre, [1, 1.25, 0])


@pytest.mark.parametrize(
    ("cards", "what"),
    [
        ("PLOAD4,1,9,2.,,,,5,7\n", "element 9 is no solid or plate of the deck"),
        ("PLOAD4,1,7,2.,,,,5,6\n", "name no face of the hex8 element 7"),
        ("PLOAD4,1,7,2.,,,,5\n", "name no face"),
        ("PLOAD4,1,7,2.,,,,5,7\n+,,,,,LINE\n", "SORL is LINE"),
        ("PLOAD,1,2.,1,2,7\n", "no solid or shell has a face with the corners 1, 2, 7"),
        ("PLOAD2,1,2.,7\n", "element 7 is no plate"),
        ("FORCE1,1,1,4.,2,2\n", "give no direction"),
        ("RFORCE,1,,,1.,0.,0.,1.\n+,2.\n", "RACC states an angular acceleration"),
        ("LOAD,9,1.,1.,4\n", "set 4 holds no load"),
        ("FORCE,9,1,,1.,1.\nLOAD,9,1.,1.,9\n", "other loads have its set id"),
        ("CORD2C,6,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nGRAV,1,6,1.,1.\n", "its system is not rectangular"),
    ],
)
def test_loads_that_cannot_be_taken_are_named(read, cards, what):
    with pytest.raises(DeckError, match=what):
        read(deck("hex8", cards))
