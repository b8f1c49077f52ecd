"""Structures of shells, beams and rods as a whole: by the theory of beams and plates, each against the other, and plates
with bars below their middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import spsolve

from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.fem.nodal_forces import body_forces
from strainsight.fem.recovery import facet_strain
from strainsight.fem.shells import shell_stiffnesses
from strainsight.fem.shells.matrices import Resistance
from strainsight.mesh.additions import face_springs, with_face
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.joins import BodyForce, PointMass, RigidElement
from strainsight.mesh.model import Material, Mesh, Region
from strainsight.mesh.thin import BeamBlock, BeamSection, ShellSection
from strainsight.mesh.thin_faces import with_faces
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows

from ..beams import axes_of
from ..shared import slowly
from .shell_models import isotropic, sheet, summed, unit_square

E, NU, RHO = 2.0e11, 0.3, 7800.0
L, B, T = 1.0, 0.1, 0.01
BAR = BeamSection(area=1e-4, second=np.diag([8e-10, 6e-10]), torsion=1e-9)


def line(x, section=BAR, kind="beam", fixed=((0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (0, 5)), offset=(0.0, 0.0, 0.0)):
    """Elements between the points x (n, 3) one after the other, y of each across the z axis."""
    x = np.array(x, dtype=float)
    nodes = np.column_stack([np.arange(len(x) - 1), np.arange(1, len(x))])
    e = len(nodes)
    axes = axes_of(x[nodes], np.cross([0.0, 0.0, 1.0], x[1:] - x[:-1]))
    block = BeamBlock(
        kind, np.arange(1, e + 1), nodes, np.ones(e, int), axes, np.tile(offset, (e, 2, 1)), np.zeros((e, 2, 6), bool)
    )
    fixed, region = np.array(fixed, dtype=int).reshape(-1, 2), {1: Region(1, "PSHELL 1", 1)}
    materials, ids = {1: Material(1, E, NU, RHO)}, np.arange(1, len(x) + 1)
    return Mesh(ids, x, (), fixed, beams=(block,), regions=region, materials=materials, sections={1: section})


def straight(count=10, **kwargs):
    return line(np.column_stack([np.linspace(0, L, count + 1), np.zeros((count + 1, 2))]), **kwargs)


def strip(along=10, across=2, nu=NU, clamped=True, offset=0.0, section=ShellSection(T)):  # noqa: B008
    """A plate L × B on z = 0, clamped at x = 0."""
    material = Material(1, E, nu, RHO)
    return with_faces(sheet("quad4", along, across, rectangle, section, material, clamped, offset))


def rectangle(a, b):
    return np.column_stack([L * a, B * b, 0 * a])


def frequencies(mesh, count, **kwargs):
    model = build_model(mesh, **kwargs)
    return modes(model.stiffness.constant, model.mass.constant, count)[0]


def at_rest(model, f):
    """Displacements (n, 3) of all nodes under f (n_free,)."""
    return nodal(model, spsolve(model.stiffness.constant.tocsc(), f)[:, None]).reshape(-1, 3)


@pytest.mark.parametrize("mesh", [strip(offset=0.02), straight(offset=(0.0, 0.0, 0.02))], ids=["shells", "beams"])
def test_mass_and_centre_count_offsets_and_what_is_not_of_the_material(mesh):
    shells = bool(mesh.shells)
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(RHO * L * (B * T if shells else 1e-4))
    np.testing.assert_allclose(centre, [L / 2, B / 2 if shells else 0.0, 0.02], atol=1e-12)
    more = replace(mesh, sections={1: replace(mesh.sections[1], nonstructural=3.0)})
    assert mass_properties(more)[0] == pytest.approx(mass + 3.0 * L * (B if shells else 1.0))


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_weight_bends_a_strip_as_a_beam(offset):
    """w = ρ g t L⁴/(8 E t³/12) at the tip, whatever the offset of the plate from its nodes."""
    mesh = strip(40, nu=0.0, offset=offset)
    model = build_model(mesh)
    weight = body_forces(mesh, BodyForce(acceleration=np.array([0.0, 0.0, -9.81])))
    f = np.zeros(model.constraint.transform.shape[0])
    f[: 3 * len(mesh.position)].reshape(-1, 3)[weight.nodes] = weight.force
    if weight.moment is not None:
        f[model.constraint.rotations(weight.nodes)] = weight.moment
    z = at_rest(model, model.constraint.transform.T @ f)
    tip = np.isclose(mesh.position[: mesh.own_nodes, 0], L)
    expected = -RHO * 9.81 * T * L**4 / (8 * E * T**3 / 12)
    np.testing.assert_allclose(z[: mesh.own_nodes][tip, 2], expected, rtol=2e-3)


@pytest.mark.parametrize("mesh", [strip(4), straight(4)], ids=["shells", "beams"])
def test_stiffness_and_mass_are_affine_in_modulus_and_density(mesh):
    sections = {1: replace(mesh.sections[1], nonstructural=2.0)}
    mesh = replace(mesh, sections=sections)
    parameters = (Parameter("E", "youngs_modulus", (1,), E), Parameter("rho", "density", (1,), RHO))
    model, theta = build_model(mesh, parameters), {"E": 1.3 * E, "rho": 0.8 * RHO}
    other = replace(mesh, materials={1: Material(1, 1.3 * E, NU, 0.8 * RHO)})
    for own, whole in zip(
        (model.stiffness, model.mass), (build_model(other).stiffness, build_model(other).mass), strict=True
    ):
        difference = own.at(theta) - whole.constant
        assert abs(difference).max() <= 1e-12 * abs(whole.constant).max()


def test_beams_that_do_not_bend_are_rods():
    x = [[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.4, 0.3, 0.8]]
    ends = np.array([(0, 3), (1, 3), (2, 3)])

    def tripod(kind):
        mesh = line(x, BeamSection(area=1e-4), kind, [(i, c) for i in range(3) for c in range(3)])
        axes = axes_of(np.array(x, float)[ends], (0.0, 1.0, 0.0))
        return replace(mesh, beams=(replace(mesh.beams[0], nodes=ends, axes=axes),))

    beams, rods = build_model(tripod("beam")), build_model(tripod("rod"))
    f = (3.0, 4.0, -5.0)
    moved = []
    for model in (beams, rods):
        S = input_shape(model, [PointLoad("f", direction=f, node_id=4)])
        moved.append(at_rest(model, S[:, 0])[3])
    along = np.array(x)[3] - np.array(x)[:3]
    length = np.linalg.norm(along, axis=1)
    n = along / length[:, None]
    K = np.einsum("b,bi,bj->ij", E * 1e-4 / length, n, n)
    expected = np.linalg.solve(K, np.array(f) / np.linalg.norm(f))
    np.testing.assert_allclose(moved, [expected, expected], rtol=1e-9)


def test_what_is_across_a_face_is_that_of_plane_stress():
    mesh = strip(2)
    z = np.zeros((len(mesh.position), 3))
    a, b = 2e-4, -5e-5
    z[:, 0], z[:, 1] = a * mesh.position[:, 0], b * mesh.position[:, 1]
    z[:, 2] = 0.3 * mesh.position[:, 0]  # as a turn, which strains nothing along the face
    facets = exterior_facets(mesh)
    tensor = (facet_strain(mesh, facets).matrix @ z.reshape(-1, 1)).reshape(-1, 6)
    expected = [a, b, -NU / (1 - NU) * (a + b), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(
        tensor[facets.facet == UPPER], np.tile(expected, (np.sum(facets.facet == UPPER), 1)), atol=1e-16
    )


def test_beams_and_shells_hold_a_solid_by_ties(box):
    """A stiff cube at the end of a beam is a point mass: f = √(3 E I/(m L³))/2π with its distance and turning inertia."""
    cube = box("hex8", (1, 1, 1))
    side = 0.1
    cube = replace(cube, position=cube.position * (side / np.ptp(cube.position[:, 0])))
    n = len(cube.position)
    x = np.column_stack([np.linspace(-L, 0, 11), np.zeros((11, 2))])
    at = cube.position - cube.position.mean(axis=0) + [side / 2, 0.0, 0.0]
    beam = straight(10)
    mesh = Mesh(
        np.arange(1, n + 12),
        np.vstack([at, x]),
        tuple(replace(block, region=np.full(len(block.ids), 2), ids=block.ids + 100) for block in cube.blocks),
        regions={1: Region(1, "PBAR 1", 1), 2: Region(2, "PSOLID 2", 2)},
        materials={1: Material(1, E, NU, 1.0), 2: Material(2, E, NU, RHO)},
        fixed=np.array([(n, c) for c in range(6)]),
        rigid=(RigidElement(1, n + 10, np.flatnonzero(np.isclose(at[:, 0], 0.0)), (0, 1, 2)),),
        beams=(replace(beam.beams[0], nodes=beam.beams[0].nodes + n),),
        sections={1: BAR},
    )
    m, I = RHO * side**3, 6e-10
    c, J = side / 2, RHO * side**5 / 6
    flexibility = np.array([[L**3 / 3, L**2 / 2], [L**2 / 2, L]]) / (E * I)
    M = np.array([[m, m * c], [m * c, m * c**2 + J]])
    expected = np.sqrt(1 / np.linalg.eigvals(flexibility @ M).real.max()) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(mesh, 1)[0], expected, rtol=2e-3)


def test_a_shell_that_nothing_holds_is_named_and_may_be_free():
    with pytest.raises(UserError, match=r"translation x.*rotation about"):
        build_model(strip(clamped=False))
    model = build_model(strip(clamped=False), free=True)
    assert model.rigid.shape[1] == 6
    K = model.stiffness.constant
    assert np.abs(K @ model.rigid).max() <= 1e-9 * abs(K).max() * np.abs(model.rigid).max()


def test_a_clamped_rotation_counts_and_a_pinned_edge_turns():
    held = strip(nu=0.0)
    pinned = replace(held, fixed=held.fixed[held.fixed[:, 1] < 3])
    with pytest.raises(UserError, match="rotation about y"):
        build_model(pinned)


def test_a_point_mass_turns_with_the_node_of_a_beam():
    """A mass beside the tip of a cantilever has the frequency of its moment of inertia in torsion: √(GJ/(m d² L))/2π."""
    m, d = 0.5, 0.3
    mesh = straight(4, section=BeamSection(area=1e-2, second=np.diag([8e-5, 8e-5]), torsion=1e-9))
    mass = (PointMass(1, 4, m, offset=np.array([0.0, d, 0.0])),)
    mesh = replace(mesh, materials={1: Material(1, E, NU, 0.01)}, point_masses=mass)
    expected = np.sqrt(E / (2 * (1 + NU)) * 1e-9 / (m * d**2 * L)) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(mesh, 1)[0], expected, rtol=1e-3)


def test_a_shaft_twists_with_its_own_inertia():
    """f = √(G/ρ)/4L of a round one, whose torsion constant is its polar moment."""
    mesh = straight(40, section=BeamSection(area=1e-2, second=np.diag([8e-4, 8e-4]), torsion=1.6e-3))
    expected = np.sqrt(E / (2 * (1 + NU)) / RHO) / (4 * L)
    assert np.abs(frequencies(mesh, 12) / expected - 1).min() < 1e-3


def test_rods_in_a_line_do_not_turn_about_it():
    fixed = [(0, 0), *((i, c) for i in range(4) for c in (1, 2))]
    mesh = straight(3, kind="rod", section=BeamSection(area=1e-4), fixed=fixed)
    np.testing.assert_allclose(frequencies(mesh, 1), np.sqrt(E / RHO) / (4 * L), rtol=0.02)


@pytest.mark.parametrize(
    "load", [{"direction": (1, 0, 0)}, {"direction": (0, 1, 0)}, {"direction": (0, 0, 1)}, {"moment": (1, 0, 0)}]
)
def test_strains_on_the_faces_are_those_of_a_solid_plate(box, load):
    """A cantilever plate that is pulled, bent in and out of its plane, and twisted, against quadratic hexahedra: strain at the
    middle of the faces of the shells, along and at 45° to it, in the middle third of its length."""
    n = (30, 6)
    solid = box("hex20", (*n, 1), size=(L, B, T), material=(E, NU, RHO), clamp_root=True)
    solid = replace(solid, position=solid.position - np.array([0, 0, T / 2]))
    read = []
    for mesh in (strip(*n), solid):
        tip = np.flatnonzero(np.isclose(mesh.position[: mesh.own_nodes, 0], L))
        mesh = replace(mesh, node_sets={"tip": mesh.node_ids[tip]})
        model = build_model(mesh)
        z = at_rest(model, input_shape(model, [PointLoad("f", node_set="tip", **load)])[:, 0]).reshape(-1, 1)
        every = candidates(mesh, exterior_facets(mesh), axis=(1.0, 0.3, 0.2), angles=(0.0, 45.0), on_constraints=True)
        x, y, height = every.position.T
        own = np.flatnonzero((np.abs(x - L / 2) < L / 6) & (np.abs(height) > 0.49 * T))
        own = own[np.lexsort((every.angle[own], height[own], y[own].round(9), x[own].round(9)))]
        read.append(channel_rows(mesh.position, every, z)[own, 0])
    np.testing.assert_allclose(read[0], read[1], atol=0.02 * np.abs(read[1]).max())


@pytest.mark.parametrize("load", [{"direction": (0.0, 0.0, -1.0)}, {"pressure": True}])
def test_a_plate_on_a_bed_under_one_of_its_faces_sinks_evenly_under_what_is_spread_over_the_other(load):
    """w = F/k of a bed as stiff as k, F = 1 N or 1 Pa times the area; the bed holds against turning too, and nothing bends."""
    mesh = with_faces(strip(clamped=False))
    facets = exterior_facets(mesh)
    for face, number in (("upper", UPPER), ("lower", LOWER)):
        mesh = with_face(mesh, face, facets, np.flatnonzero(facets.facet == number))
    k = np.array([2e4, 2e4, 5e4])
    mesh = replace(mesh, springs=(face_springs(mesh, "bed", "lower", k),))
    model = build_model(mesh)
    S = input_shape(model, [PointLoad("f", node_set="upper", **load)])
    z = nodal(model, spsolve(model.stiffness.constant.tocsc(), S[:, 0])[:, None])[:, 0].reshape(-1, 3)
    force = L * B if "pressure" in load else 1.0
    np.testing.assert_allclose(z, np.tile([0.0, 0.0, -force / k[2]], (len(z), 1)), atol=1e-6 * force / k[2])


LENGTH, WIDTH, SKIN = 432.0, 108.0, 3.0
MODULUS, POISSON, DENSITY = 7.1e4, 0.33, 2.81e-9
AREA, I1, I2, J, BELOW = 96.0, 4608.0, 128.0, 458.0, -13.5
"""Of a blade of 4 × 24 mm on its lower side; in mm."""


SHAPES = {
    "quad4": [[0, 0, 0], [9, 1, 0], [8, 7, 0], [-1, 6, 0]],
    "tri3": [[0, 0, 0], [9, 1, 0], [2, 7, 0]],
    "quad8": [[0, 0, 0], [9, 1, 0], [8, 7, 0], [-1, 6, 0]],
    "tri6": [[0, 0, 0], [9, 1, 0], [2, 7, 0]],
}
"""Corners [mm]."""


def by_ritz(highest=4, terms=60):
    """Frequencies [Hz] of the plate, simply supported, ends of the bar likewise, of up to so many half waves along it.

    u = cos kx Σ u_n sin p_n y, v = sin kx Σ v_n cos p_n y, w = sin kx Σ w_n sin p_n y; the bar in the middle, e off the plate,
    moves by u − e w,x, v − e w,y and w and twists by w,y. Kirchhoff's plate, Euler's bar.
    """
    n = np.arange(terms)
    p, i, none = n * np.pi / WIDTH, np.arange(terms), np.zeros(terms)
    s, c = np.sin(p * WIDTH / 2), np.cos(p * WIDTH / 2)
    stretch, shear = MODULUS * SKIN / (1 - POISSON**2), MODULUS * SKIN / 2 / (1 + POISSON)
    area = LENGTH * WIDTH / 4 * np.where(n == 0, 2.0, 1.0)
    found = []
    for k in np.arange(1, highest + 1) * np.pi / LENGTH:
        K, M = np.zeros((2, 3, terms, 3, terms))
        K[0, i, 0, i] = area * (stretch * k**2 + shear * p**2)
        K[1, i, 1, i] = area * (stretch * p**2 + shear * k**2)
        K[0, i, 1, i] = K[1, i, 0, i] = area * (POISSON * stretch + shear) * k * p
        K[2, i, 2, i] = area * stretch * SKIN**2 / 12 * (k**2 + p**2) ** 2
        for own in range(3):
            M[own, i, own, i] = area * DENSITY * SKIN
        M[2, i, 2, i] += area * DENSITY * SKIN**3 / 12 * (k**2 + p**2)
        K, M = (X.reshape(3 * terms, -1) for X in (K, M))
        u, v, w, twist = (
            np.concatenate(parts)
            for parts in ((s, none, -BELOW * k * s), (none, c, -BELOW * p * c), (none, none, s), (none, none, p * c))
        )
        turning = MODULUS / 2 / (1 + POISSON) * J
        stiff = ((u, MODULUS * AREA * k**2), (w, MODULUS * I1 * k**4), (v, MODULUS * I2 * k**4), (twist, turning * k**2))
        heavy = ((u, AREA), (v, AREA + I2 * k**2), (w, AREA + I1 * k**2), (twist, I1 + I2))
        K += sum(LENGTH / 2 * factor * np.outer(a, a) for a, factor in stiff)
        M += sum(LENGTH / 2 * DENSITY * factor * np.outer(a, a) for a, factor in heavy)
        there = np.flatnonzero(np.tile(n > 0, 3) | (np.arange(3 * terms) // terms == 1))
        found.append(np.sqrt(eigh(K[np.ix_(there, there)], M[np.ix_(there, there)], eigvals_only=True)[:4]) / 2 / np.pi)
    return np.sort(np.concatenate(found))


def plate(kind, across):
    """So many elements across, and bars along the sides of those in the middle, of the second order along their halves."""
    mesh = sheet(
        kind,
        4 * across,
        across,
        lambda a, b: np.column_stack([LENGTH * a, WIDTH * (b - 0.5), 0 * a]),
        ShellSection(SKIN),
        Material(1, MODULUS, POISSON, DENSITY),
    )
    x, y, _ = mesh.position.T
    middle = np.flatnonzero(y == 0)
    ends = np.column_stack([middle[:-1], middle[1:]])
    e = len(ends)
    axes = axes_of(mesh.position[ends], (0.0, 0.0, 1.0))
    offset, released = np.tile([0.0, 0.0, BELOW], (e, 2, 1)), np.zeros((e, 2, 6), bool)
    held = [(node, c) for node in np.flatnonzero((x == 0) | (x == LENGTH)) for c in (1, 2, 3)]
    held += [(node, c) for node in np.flatnonzero(np.abs(y) == WIDTH / 2) for c in (0, 2, 4)]
    return replace(
        mesh,
        fixed=np.array(sorted(set(held))),
        beams=(BeamBlock("beam", 10**6 + np.arange(e), ends, np.full(e, 2), axes, offset, released),),
        sections={**mesh.sections, 2: BeamSection(AREA, np.diag([I1, I2]), J)},
        regions={**mesh.regions, 2: Region(2, "PBAR 2", 1)},
    )


@pytest.mark.parametrize(("kind", "across"), [("quad4", 18), *slowly(("tri3", 18), ("quad8", 6)), ("tri6", 6)])
def test_a_plate_tilts_with_its_bar_as_by_ritz(kind, across):
    """In mm and t."""
    model = build_model(plate(kind, across))
    found = modes(model.stiffness.constant, model.mass.constant, 6)[0]
    np.testing.assert_allclose(found, by_ritz()[:6], rtol=0.0065)


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_let_go_stays_free_of_rigid_motions(kind):
    x = np.array(SHAPES[kind], float)
    if kind in ("quad8", "tri6"):
        x = np.concatenate([x, (x + np.roll(x, -1, axis=0)) / 2])
    beside = np.arange(len(x))[None] % 2 == 0
    K = shell_stiffnesses(x[None], Resistance(*isotropic(MODULUS, POISSON, SKIN, 1)), np.full(1, 2.0), np.ones(1, int), beside)[0]
    values = np.linalg.eigvalsh(K)
    assert (np.abs(values[:6]) < 1e-9 * values[-1]).all()
    assert values[6] > 0


@pytest.mark.parametrize("kind", ["quad4", "tri3"])
def test_constant_stress_passes_where_rotations_are_let_go(kind):
    a, b, cells = unit_square(4, 4, kind)
    x = np.column_stack([a + 0.1 * a * b, b - 0.15 * a * b + 0.1 * a**2, 0 * a])
    beside = np.isin(cells, [6, 7, 12, 13])
    own = shell_stiffnesses(
        x[cells], Resistance(*isotropic(1.0, POISSON, 0.05, len(cells))), np.zeros(len(cells)), np.arange(len(cells)), beside
    )
    G = np.array([[0.3, 0.7], [-0.2, 0.5]])
    u = np.zeros((len(x), 6))
    u[:, :2], u[:, 5] = x[:, :2] @ G.T, (G[1, 0] - G[0, 1]) / 2
    force = (summed(own, cells, len(x)) @ u.ravel()).reshape(-1, 6)
    inner = (a > 0) & (a < 1) & (b > 0) & (b < 1)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
