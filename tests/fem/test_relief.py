"""Motions that nothing holds, hinges inside of a mesh, and free structures: inertia relief and their modes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.equations import turning_nodes
from strainsight.fem.factorisation import factorise_free, pin_rigid_motions, relief_of
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.stiff_pieces import stiff_pieces
from strainsight.fem.support import rigid_body_motions, rigid_motions
from strainsight.mesh.joins import AveragingElement, PointMass, RigidElement
from strainsight.mesh.thin import ShellBlock, ShellSection

from ..bodies import with_nodes
from ..mesh.boxes import both

E, RHO, L, A = 2.1e11, 7850.0, 1.0, 0.02 * 0.03
FREE = np.array([4.730040745, 7.853204624, 10.995607838])
"""βL of a free-free beam (Blevins, table 8-1)."""


@pytest.fixture(scope="module")
def bar(box):
    """1 m long, 20 × 30 mm, ν = 0, so that it is a bar and no plate."""
    return build_model(box("hex20", (32, 1, 1), size=(L, 0.02, 0.03), material=(E, 0.0, RHO)), free=True)


def at(model):
    return model.stiffness.constant, model.mass.constant


def test_bending_modes_are_those_of_a_free_free_beam(bar):
    K, M = at(bar)
    frequency, shapes = modes(K, M, 6, rigid=bar.rigid)
    euler = np.sort(np.outer(FREE**2, np.sqrt(E / 12 / RHO) * np.array([0.02, 0.03])).ravel()) / (2 * np.pi * L**2)
    assert np.allclose(frequency[:3], euler[:3], rtol=4e-3)  # shear and rotary inertia lower them by 0.1 to 0.3 %
    assert np.allclose(shapes.T @ (M @ shapes), np.eye(6), atol=1e-9)
    assert np.abs(bar.rigid.T @ (M @ shapes)).max() < 1e-9 * np.abs(bar.rigid.T @ (M @ bar.rigid)).max()


@pytest.mark.parametrize("counts", [(2, 1, 1), (9, 3, 3)])
def test_a_dense_and_an_iterative_solution_agree_with_all_eigenvalues(box, counts):
    model = build_model(box("hex8", counts, size=(1.0, 0.3, 0.2)), free=True)
    K, M = at(model)
    every = eigh(K.toarray(), M.toarray(), eigvals_only=True)
    assert np.all(np.abs(every[:6]) < 1e-9 * every[6])
    found, shapes = modes(K, M, 5, rigid=model.rigid)
    assert np.allclose((2 * np.pi * found) ** 2, every[6:11], rtol=1e-8)
    assert np.allclose(K @ shapes, (M @ shapes) * every[6:11], atol=1e-6 * abs(K @ shapes).max())


def test_few_masses_on_a_massless_body_vibrate_against_each_other():
    """Two masses and a spring, ω = √(k (1/m₁ + 1/m₂)), in the middle of a long chain of massless links."""
    n, k, m1, m2 = 400, 1e4, 2.0, 3.0
    ends = np.ones(n)
    ends[1:-1] = 2.0
    K = sparse.csr_array(k * (n - 1) * sparse.diags_array([ends, -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    mass = np.zeros(n)
    mass[0], mass[-1] = m1, m2
    M = sparse.csr_array(sparse.diags_array(mass))
    found, shapes = modes(K, M, 1, rigid=np.ones((n, 1)))
    assert 2 * np.pi * found[0] == pytest.approx(np.sqrt(k * (1 / m1 + 1 / m2)), rel=1e-9)
    assert m1 * shapes[0, 0] + m2 * shapes[-1, 0] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(UserError, match="degrees of freedom with mass allow only 1 in addition to the rigid-body modes"):
        modes(K, M, 2, rigid=np.ones((n, 1)))


def test_a_bar_that_an_end_force_accelerates_has_a_strain_that_grows_along_it(bar):
    """N(x) = F x/L behind the force at x = L: u(x) − u(0) = F x²/(2EAL); the acceleration is F/m, whatever the point."""
    K, M = at(bar)
    x = bar.mesh.position
    end = np.isclose(x[:, 0], L)
    # consistent forces of a uniform traction on the end of one brick of twenty nodes: −1/12 at corners, 1/3 at mid-sides
    corner = end & np.isin(np.round(x[:, 1], 6), [0, 0.02]) & np.isin(np.round(x[:, 2], 6), [0, 0.03])
    f = np.zeros(3 * len(x))
    f[3 * np.flatnonzero(end & corner)] = -1 / 12
    f[3 * np.flatnonzero(end & ~corner)] = 1 / 3
    relief = relief_of(M, bar.rigid)
    z = factorise_free(K, relief).solve(f)
    u = z[::3]
    expected = x[:, 0] ** 2 / (2 * E * A * L)
    assert np.allclose(u - u[x[:, 0] == 0].mean(), expected, atol=1e-6 * expected.max())
    acceleration = relief.shapes @ (relief.shapes.T @ f)
    assert np.allclose(acceleration[::3], 1 / (RHO * A * L), rtol=1e-9)
    assert np.abs(acceleration[1::3]).max() < 1e-9 * acceleration[::3].max()
    assert np.allclose(relief.balance(f[:, None]).sum(), 0.0, atol=1e-9)


def test_inertia_relief_does_not_depend_on_pinning_springs(bar):
    """K⁺ is that of the pseudo-inverse in the elastic space: KK⁺f = f − MRRᵀf and RᵀMK⁺f = 0 define it."""
    K, M = at(bar)
    relief = relief_of(M, bar.rigid)
    f = np.random.default_rng(3).standard_normal((bar.size, 3))
    z = factorise_free(K, relief).solve(f)
    left = K @ z - relief.balance(f)
    assert np.abs(left).max() < 1e-7 * np.abs(f).max()
    assert np.abs(relief.inertia.T @ z).max() < 1e-9 * np.abs(z).max() * np.abs(relief.inertia).sum(axis=0).max()
    again = relief_of(M, bar.rigid @ np.random.default_rng(5).standard_normal((6, 6)))
    assert np.allclose(factorise_free(K, again).solve(f), z, atol=1e-7 * np.abs(z).max())
    assert np.linalg.eigvalsh(pin_rigid_motions(K, bar.rigid).toarray()[:60, :60])[0] > 0


@pytest.mark.parametrize("kind", ["tet10", "hex8", "wedge15"])
def test_rigid_motions_are_the_null_space_of_the_stiffness(box, kind):
    model = build_model(box(kind, (3, 2, 2), distort=0.2), (Parameter("E", "youngs_modulus", (1,), 2.1e11),), free=True)
    K = model.stiffness.at({"E": 2.1e11})
    assert model.rigid.shape == (model.size, 6)
    assert np.linalg.matrix_rank(model.rigid) == 6
    assert np.abs(K @ model.rigid).max() < 1e-12 * np.abs(K).max() * np.abs(model.rigid).max()


def test_rigid_motions_left_by_a_roller(box):
    mesh = box("hex8", (2, 2, 2))
    bottom = np.array([(i, 2) for i in np.flatnonzero(mesh.position[:, 2] == 0)])
    assert build_model(replace(mesh, fixed=bottom), free=True).rigid.shape[1] == 3
    top = np.flatnonzero(mesh.position[:, 2] == 1)
    mesh = replace(
        with_nodes(mesh, [0.5, 0.5, 2.0]),
        rigid=(RigidElement(1, 27, top, (0, 1, 2)),),
        point_masses=(PointMass(1, 27, 5.0, np.zeros(3), np.zeros((3, 3))),),
    )
    model = build_model(mesh, free=True)
    K, _ = at(model)
    assert model.rigid.shape[1] == 6
    assert np.abs(K @ model.rigid).max() < 1e-12 * np.abs(K).max()


def test_loose_parts_and_supported_structures_are_refused(box):
    apart = two_boxes(box, 0.5)
    with pytest.raises(
        UserError, match="the 2 parts of the structure move relative to each other: 12 rigid-body motions"
    ) as caught:
        rigid_motions(apart, constraint_transform(apart))
    assert caught.value.key == "mesh.free"
    held = box("hex8", (1, 1, 1), clamp_root=True)
    with pytest.raises(UserError, match="prevent every rigid-body motion") as caught:
        build_model(held, free=True)
    assert "Remove mesh.free" in caught.value.remedy


def test_without_supports_both_remedies_are_named(box):
    with pytest.raises(UserError, match="can move freely") as caught:
        build_model(box("hex8", (4, 1, 1), size=(1.0, 0.1, 0.1)))
    assert "mesh.free: true" in caught.value.remedy
    assert "mesh.supports" in caught.value.remedy


ALL = ("translation x", "translation y", "translation z", "rotation about x", "rotation about y", "rotation about z")


def motions(mesh, fixed=(), **change):
    mesh = replace(mesh, fixed=np.array(fixed, dtype=np.int64).reshape(-1, 2), **change)
    return rigid_body_motions(mesh, constraint_transform(mesh))


def two_boxes(box, gap):
    mesh = box("hex8", (1, 1, 1))
    return both(mesh, replace(mesh, position=mesh.position + np.array([1 + gap, 0, 0])))


@pytest.mark.parametrize(("unit", "offset"), [(1e-6, 0.0), (1.0, 0.0), (1.0, 1e4), (1e4, 0.0)])
@pytest.mark.parametrize("kind", ["tet10", "hex8"])
def test_every_free_motion_is_named_in_any_unit(box, kind, unit, offset):
    mesh = box(kind, (2, 2, 2), size=(unit, unit, unit))
    mesh = replace(mesh, position=mesh.position + offset * unit)
    places = unit * (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + offset)
    origin, x, y = (int(np.argmin(np.linalg.norm(mesh.position - place, axis=1))) for place in places)
    assert motions(mesh) == ALL
    bottom = [(i, 2) for i in np.flatnonzero(np.isclose(mesh.position[:, 2], mesh.position[:, 2].min()))]
    assert motions(mesh, bottom) == ("translation x", "translation y", "rotation about z")
    isostatic = [*((origin, c) for c in range(3)), (x, 1), (x, 2), (y, 2)]
    assert motions(mesh, isostatic) == ()
    for left_out in range(6):
        assert len(motions(mesh, isostatic[:left_out] + isostatic[left_out + 1 :])) == 1


def test_hinge_line_is_described_by_its_axis(box):
    mesh = box("hex8", (1, 1, 1))
    hinge = [(i, c) for i in np.flatnonzero((mesh.position[:, 0] == 0) & (mesh.position[:, 1] == 0)) for c in range(3)]
    assert motions(mesh, hinge) == ("rotation about z through (0, 0, 0.5) m",)
    diagonal = [
        (i, c)
        for i in np.flatnonzero((mesh.position[:, 0] == mesh.position[:, 1]) & (mesh.position[:, 2] == 0))
        for c in range(3)
    ]
    assert motions(mesh, diagonal)[0].startswith("rotation about (0.7071, 0.7071, 0) through")


def test_motions_about_a_pin_are_the_three_along_the_axes_and_no_mixture(box):
    """All three are equally free: any combination of them is a free motion too, and rounding must not pick one."""
    mesh = box("hex8", (1, 1, 1))
    pin = [(int(np.argmin(np.linalg.norm(mesh.position, axis=1))), c) for c in range(3)]
    through = ("(0.5, 0, 0)", "(0, 0.5, 0)", "(0, 0, 0.5)")
    assert motions(mesh, pin) == tuple(
        f"rotation about {axis} through {point} m" for axis, point in zip("xyz", through, strict=True)
    )
    assert motions(mesh, pin[:1]) == (
        "translation y",
        "translation z",
        "rotation about x",
        "rotation about y through (0.5, 0.5, 0) m",
        "rotation about z through (0.5, 0, 0.5) m",
    )


def test_parts_joined_by_rigid_elements_are_held(box):
    mesh = two_boxes(box, 0.5)
    mesh = with_nodes(mesh, [1.25, 0.5, 0.5])
    root = [(i, c) for i in np.flatnonzero(mesh.position[:, 0] == 0) for c in range(3)]
    faces = np.flatnonzero(np.isin(mesh.position[:, 0], [1.0, 1.5]))
    assert motions(mesh, root, rigid=(RigidElement(1, 16, faces, (0, 1, 2)),)) == ()
    # in y and z only, the reference still pivots about the first face: just the spin about x is held
    pivot = motions(mesh, root, rigid=(RigidElement(1, 16, faces, (1, 2)),))
    assert pivot == tuple(f"{motion} of the part with node 9" for motion in ALL if motion != "rotation about x")


def test_a_reference_that_can_spin_about_its_nodes_is_found(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    mesh = with_nodes(mesh, [1.0, 2.0, 2.0])
    line = np.flatnonzero((mesh.position[:8, 0] == 1) & (mesh.position[:8, 1] == mesh.position[:8, 2]))
    found = motions(mesh, mesh.fixed, rigid=(RigidElement(1, 8, line, (0, 1, 2)),))
    assert found == ("node 9, rotation y of a rigid element", "node 9, rotation z of a rigid element")


SECTION = {9: ShellSection(0.05)}


def with_plates(mesh, quads):
    """Shells on nodes of a mesh of solids, of its material."""
    e = len(quads)
    block = ShellBlock("quad4", np.arange(1000, 1000 + e), quads, np.full(e, 9), np.zeros(e), np.full((e, 3), np.nan))
    regions = {**mesh.regions, 9: replace(mesh.regions[1], id=9)}
    return replace(mesh, shells=(block,) if e else (), sections=SECTION, regions=regions)


def held_motions(mesh):
    """How supports and ties of a mesh hold its nodes."""
    return constraint_transform(mesh, rotations=turning_nodes(mesh))


def some_of(mesh, chosen):
    block = mesh.blocks[0]
    return replace(
        mesh,
        blocks=(replace(block, ids=block.ids[chosen], nodes=block.nodes[chosen], region=block.region[chosen]),),
    )


def inner_quads(mesh):
    """Faces of all cells of a mesh of hex8, each once, on which plates can lie."""
    faces = [(0, 3, 7, 4), (0, 1, 5, 4), (0, 1, 2, 3), (1, 2, 6, 5), (3, 2, 6, 7), (4, 5, 6, 7)]
    quads = np.concatenate([mesh.blocks[0].nodes[:, list(face)] for face in faces])
    return quads[np.unique(np.sort(quads, axis=1), axis=0, return_index=True)[1]]


@pytest.mark.parametrize("seed", range(40))
def test_as_many_motions_are_found_as_the_stiffness_has_zero_eigenvalues(box, seed):
    """Cells of a 3 × 2 × 2 box, and plates between its nodes, drawn anew: they hang together by faces, edges and corners."""
    rng = np.random.default_rng(seed)
    full = box("hex8", (3, 2, 2), size=(1.0, 0.8, 0.7), distort=0.1, seed=seed)
    quads = inner_quads(full)
    mesh = some_of(full, np.sort(rng.choice(12, rng.integers(2, 6), replace=False)))
    mesh = with_plates(mesh, quads[rng.choice(len(quads), rng.integers(0, 4), replace=False)])
    K = build_model(mesh, supported=False).stiffness.constant.toarray()
    strength = np.linalg.eigvalsh(K / np.sqrt(np.outer(K.diagonal(), K.diagonal())))
    zeros = int(np.count_nonzero(strength < 1e-10))
    assert strength[zeros] > 1e-7
    constraint = held_motions(mesh)
    if zeros == 6:
        assert rigid_motions(mesh, constraint).shape[1] == 6
        return
    with pytest.raises(UserError, match="move relative to each other") as caught:
        rigid_motions(mesh, constraint)
    assert int(re.search(r"(\d+) rigid-body motions", str(caught.value))[1]) == zeros


def stand(box, **more):
    """A plate on the middle line of the top of a block that is held below, edge-on."""
    mesh = box("hex8", (2, 2, 1), size=(1.0, 1.0, 0.5))
    below = np.flatnonzero(mesh.position[:, 2] == 0)
    line = np.flatnonzero((mesh.position[:, 0] == 0.5) & (mesh.position[:, 2] == 0.5))
    n = len(mesh.position)
    above = mesh.position[line] + np.array([0.0, 0.0, 0.3])
    mesh = replace(
        with_nodes(mesh, above),
        fixed=np.array([(i, c) for i in below for c in range(3)]),
    )
    quads = np.array([[line[i], line[i + 1], n + i + 1, n + i] for i in range(len(line) - 1)])
    return replace(with_plates(mesh, quads), **more), line


def test_a_plate_that_stands_on_a_solid_is_hinged_and_its_line_named(box):
    mesh, _ = stand(box)
    motions = rigid_body_motions(mesh, held_motions(mesh))
    assert motions == ("rotation about y through (0.5, 0.5, 0.5) m of the part with node 19",)
    with pytest.raises(UserError, match="move freely: rotation about y through"):
        build_model(mesh)


def test_tied_rotations_remove_the_hinge(box):
    mesh, line = stand(box)
    around = np.flatnonzero((np.abs(mesh.position[:, 2] - 0.5) < 1e-9) & (mesh.position[:, 0] != 0.5))
    tie = AveragingElement(1, int(line[1]), around, np.ones(len(around)), (3, 4, 5))
    held = replace(mesh, averaging=(tie,))
    assert rigid_body_motions(held, held_motions(held)) == ()


def test_corner_of_two_plates_is_rigid(box):
    mesh, line = stand(box)
    n = len(mesh.position)
    side = int(np.flatnonzero(np.all(np.isclose(mesh.position, [1.0, 0.5, 0.5]), axis=1))[0])
    mesh = with_nodes(mesh, mesh.position[side] + np.array([0.0, 0.0, 0.3]))
    top = int(np.flatnonzero(np.all(np.isclose(mesh.position, [0.5, 0.5, 0.8]), axis=1))[0])
    corner = with_plates(mesh, np.vstack([mesh.shells[0].nodes, [[line[1], side, n, top]]]))
    assert stiff_pieces(corner).count == 1
    assert rigid_body_motions(corner, held_motions(corner)) == ()


@pytest.mark.parametrize("kind", ["tet4", "tet10", "wedge15", "hex20"])
def test_a_body_of_one_kind_is_one_piece(box, kind):
    mesh = box(kind, (3, 2, 2), distort=0.1)
    found = stiff_pieces(mesh)
    assert found.count == 1
    np.testing.assert_array_equal(np.unique(found.label[mesh.nodes_of_elements]), [0])
