"""A model from modes and static responses, against the closed form of a bar; what is refused; how ties follow results."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.mass import mass_product
from strainsight.fem.model import nodal
from strainsight.foreign.imported_modes import Results, check_rows, extend_motion, results_model
from strainsight.mesh.joins import AveragingElement, PointMass, RigidElement
from strainsight.mesh.model import Material
from strainsight.mesh.thin import ShellSection
from strainsight.mesh.thin_faces import with_faces

from ..bodies import with_nodes
from ..fem.conftest import make_box
from ..fem.shell_models import sheet

E, RHO, L, SIDE, MODES = 2.1e11, 7850.0, 2.0, 0.1, 3
AREA = SIDE**2
FIRST = np.arange(1, MODES + 1)
WAVE = (2 * FIRST - 1) * np.pi / (2 * L)
ENERGY = L / (E * AREA)
"""z(L) of 1 N at the end: x/EA."""
LOADS = (PointLoad("end", (1.0, 0.0, 0.0), node_set="end"), PointLoad("middle", (1.0, 0.0, 0.0), node_set="middle"))


@pytest.fixture(scope="module")
def bar():
    """A bar along x, held at x = 0, which moves along x alone."""
    mesh = make_box("hex8", (400, 1, 1), (L, SIDE, SIDE), material=(E, 0.0, RHO))
    x = mesh.position[:, 0]
    return replace(mesh, node_sets={"end": mesh.node_ids[x == L], "middle": mesh.node_ids[np.isclose(x, L / 2)]})


def along_x(mesh, values):
    """(k, n, 3) of k functions of x (k, n)."""
    found = np.zeros((*values.shape, 3))
    found[:, :, 0] = values
    return found


@dataclass(frozen=True)
class Case(Results):
    """With the motion (m + s, n, 3) of the nodes."""

    motion: np.ndarray


def results_of(mesh, loads=(0,), **more):
    """Exact modes of unit mass, φ = √(2/ρAL) sin kx, and exact responses min(x, a)/EA."""
    x = mesh.position[:, 0]
    shapes = np.sqrt(2 / (RHO * AREA * L)) * np.sin(WAVE[:, None] * x)
    static = np.array([np.minimum(x, (L, L / 2)[j]) / (E * AREA) for j in loads]).reshape(len(loads), len(x))
    own = Case(
        frequency=WAVE * np.sqrt(E / RHO) / (2 * np.pi),
        motion=along_x(mesh, np.concatenate([shapes, static])),
        load=np.array(loads, dtype=np.int64),
        modal_mass=np.ones(MODES),
        rounding=1e-16,
        where=tuple(f"a.frd, step {i}" for i in range(MODES + len(loads))),
    )
    return replace(own, **more)


def built(mesh, results, loads=LOADS[:1], scaled=None):
    names = tuple(load.name for load in loads)
    given = extend_motion(mesh, results.motion)
    found = results_model(mesh, given, results, lambda model: input_shape(model, loads), names, scaled or {})
    return found, input_shape(found.model, loads)


def without_density(mesh):
    return replace(mesh, materials={i: replace(m, density=0.0) for i, m in mesh.materials.items()})


def test_bar_matches_closed_form(bar):
    found, S = built(bar, results_of(bar))
    K, M = (X.at({}).toarray() for X in (found.model.stiffness, found.model.mass))
    assert np.allclose(np.diag(K)[:MODES], (WAVE * np.sqrt(E / RHO)) ** 2, rtol=1e-12)
    q = np.linalg.solve(K, S)
    u = nodal(found.model, q).reshape(-1, 3)
    assert np.allclose(u[:, 0], bar.position[:, 0] / (E * AREA), rtol=0, atol=1e-12 * ENERGY)
    assert q[:, 0] @ K @ q[:, 0] == pytest.approx(ENERGY, rel=1e-12)
    left = 1 - np.sum(8 / (np.pi * (2 * FIRST - 1)) ** 2)
    assert K[-1, -1] == pytest.approx(left, rel=1e-10)  # of a response of unit energy
    beyond = np.arange(MODES + 1, 20000)
    k = (2 * beyond - 1) * np.pi / (2 * L)
    mass = np.sum(2 / (RHO * AREA * L) / (k**2 * E / RHO) ** 2) / ENERGY
    assert M[-1, -1] == pytest.approx(mass, rel=2e-3)  # of linear elements, a 24th of the fourth wave each
    assert np.allclose(M[:MODES, MODES:], 0)
    assert np.allclose(M[:MODES, :MODES], np.eye(MODES))
    assert not found.notes


def test_parameters_scale_whole_matrices(bar):
    scaled = {"stiffness": ("E", E), "mass": ("rho", RHO)}
    found, _ = built(bar, results_of(bar), scaled=scaled)
    plain, _ = built(bar, results_of(bar))
    for operator, same, name, at in (
        (found.model.stiffness, plain.model.stiffness, "E", E),
        (found.model.mass, plain.model.mass, "rho", RHO),
    ):
        assert np.allclose(operator.at({name: 0.8 * at}).toarray(), 0.8 * same.at({}).toarray(), rtol=1e-14)


def test_without_densities_the_residual_is_quasi_static(bar):
    found, S = built(without_density(bar), results_of(bar))
    K, M = (X.at({}).toarray() for X in (found.model.stiffness, found.model.mass))
    above = np.sqrt(K[-1, -1] / M[-1, -1]) / (2 * np.pi)
    assert above == pytest.approx(10 * results_of(bar).frequency[-1], rel=1e-12)
    assert nodal(found.model, np.linalg.solve(K, S))[0::3].max() == pytest.approx(ENERGY, rel=1e-12)
    assert any("10 times the highest natural frequency" in text for text in found.notes)


def test_modes_are_normalised_to_unit_mass(bar):
    own, factor = results_of(bar), np.array([3.0, 0.2, 50.0])
    motion = own.motion.copy()
    motion[:MODES] *= factor[:, None, None]
    wanted, S = built(bar, own)
    stated, S_stated = built(bar, replace(own, motion=motion, modal_mass=factor**2))
    assert np.allclose(S_stated, S, rtol=1e-12)
    by_mesh, S_mesh = built(bar, replace(own, motion=motion, modal_mass=None))
    assert np.allclose(S_mesh[:MODES], S[:MODES], rtol=1e-4)
    assert any("densities of the mesh" in text for text in by_mesh.notes)
    for found in (stated, by_mesh):
        assert np.allclose(found.model.stiffness.at({}).toarray()[0, 0], wanted.model.stiffness.at({}).toarray()[0, 0])
    with pytest.raises(UserError, match="the normalisation of the modes is unknown: the file does not define it,") as caught:
        built(without_density(bar), replace(own, modal_mass=None))
    assert caught.value.key == "mesh.results.modal_mass"
    with pytest.raises(UserError, match="the modal mass of mode 3 from the densities of the mesh is 2500 times the value"):
        built(bar, replace(own, motion=motion))


@pytest.mark.parametrize("weighs", [True, False])
@pytest.mark.parametrize(
    ("factor", "said"), [(2.0, "mode 1"), (1e3, "mode 1"), (-1.0, "the work of this load"), (0.5, "work")]
)
def test_a_response_to_another_load_is_refused(bar, weighs, factor, said):
    mesh = bar if weighs else without_density(bar)
    own = results_of(bar)
    motion = np.concatenate([own.motion[:MODES], factor * own.motion[MODES:]])
    with pytest.raises(UserError, match=said) as caught:
        built(mesh, replace(own, motion=motion))
    assert caught.value.key == "mesh.results.loads.end"
    assert caught.value.where == "a.frd, step 3"


def test_responses_satisfy_reciprocity(bar):
    """z_middle(L) = z_end(L/2); 3 % off is an error that states both, a dependent response is left out."""
    own = results_of(bar, (0, 1))
    found, S = built(bar, own, LOADS)
    K = found.model.stiffness.at({}).toarray()
    u = nodal(found.model, np.linalg.solve(K, S))[0::3]
    assert np.allclose(u[:, 1], np.minimum(bar.position[:, 0], L / 2) / (E * AREA), rtol=0, atol=1e-12 * ENERGY)
    motion = own.motion.copy()
    motion[-1] *= 1.03
    with pytest.raises(
        UserError, match=r"the static displacement at load end due to load middle is 4\.9048e-10 m/N, but the one at load middle"
    ):
        built(bar, replace(own, motion=motion), LOADS)
    same = (LOADS[0], replace(LOADS[0], name="again"))
    twice = results_of(bar, (0, 0), load=np.array([0, 1]))
    found, _ = built(bar, twice, same)
    assert found.model.size == MODES + 1
    assert any("1 of 2 static responses" in text for text in found.notes)


def test_load_without_response_is_noted(bar):
    found, _ = built(bar, results_of(bar), LOADS)
    assert found.model.size == MODES + 1
    assert any(text.startswith("the results have no static response to middle") for text in found.notes)


@pytest.mark.parametrize("frequency", [0.0, -3.0, 1e-5])
def test_a_free_structure_is_refused(bar, frequency):
    own = results_of(bar)
    with pytest.raises(UserError, match="the structure is free or unstable"):
        built(bar, replace(own, frequency=np.r_[frequency, own.frequency[1:]]))


def test_results_have_to_cover_the_surface_and_the_loads(bar):
    own = results_of(bar)
    motion = own.motion.copy()
    motion[:, 7] = np.nan
    with pytest.raises(UserError, match=f"do not contain node {bar.node_ids[7]}, translation x.* at 1 of {len(bar.node_ids)}"):
        built(bar, replace(own, motion=motion))
    apart = with_nodes(bar, [3.0, 0.0, 0.0], ids=[99999])
    motion = np.concatenate([own.motion, np.full((len(own.motion), 1, 3), np.nan)], axis=1)
    loose = PointLoad("end", (1.0, 0.0, 0.0), node_id=99999)
    with pytest.raises(UserError, match=r"node 99999, translation x \(loaded node"):
        built(apart, replace(own, motion=motion), (loose,))


def test_reference_nodes_follow_their_nodes(box):
    """A rigid motion of the nodes of an RBE2 and an RBE3 is that of their reference nodes, which results of solids lack."""
    mesh = box("hex8", (2, 2, 2), (1.0, 0.5, 0.7))
    n, end = len(mesh.position), np.flatnonzero(mesh.position[:, 0] == 1.0)
    at = np.array([[1.4, 0.1, 0.2], [1.2, -0.3, 0.1]])
    mesh = replace(
        with_nodes(mesh, at, ids=[900, 901]),
        rigid=(RigidElement(1, n, end, tuple(range(3))),),
    )
    mesh = replace(mesh, averaging=(averaging(n + 1, np.flatnonzero(mesh.position[:n, 0] == 0.0)),))
    rng = np.random.default_rng(3)
    u, turn = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    motion = np.stack([u[k] + np.cross(turn[k], mesh.position) for k in range(2)])
    known = motion.copy()
    known[:, n:] = np.nan
    found = extend_motion(mesh, known)
    assert found.known.all()
    assert np.allclose(found.field[3 * n : 3 * n + 6].T.reshape(2, 2, 3), motion[:, n:], atol=1e-10)
    rows = found.constraint.rotations(np.array([n])).ravel()
    assert np.allclose(found.field[rows].T, turn, atol=1e-9)


def averaging(reference, nodes):
    return AveragingElement(2, reference, nodes, np.ones(len(nodes)), tuple(range(6)))


def test_undetermined_rows_are_unknown(box):
    mesh = box("hex8", (1, 1, 1), (1.0, 1.0, 1.0))
    edge = np.flatnonzero((mesh.position[:, 0] == 1.0) & (mesh.position[:, 1] == 1.0))
    mesh = replace(
        with_nodes(mesh, [2.0, 1.0, 0.5], ids=[900]),
        rigid=(RigidElement(1, 8, edge, (0, 1, 2)),),
    )
    motion = np.zeros((1, 9, 3))
    motion[:, 8] = np.nan
    found = extend_motion(mesh, motion)
    assert found.known[:24].all()
    assert found.known[24:27].tolist() == [True, False, True]  # the line is along z: the arm along x turns about it


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10", "wedge15"])
def test_mass_product_matches_assembled_mass(kind, box):
    """vᵀMv of u = (x, 0, 0) and of a rigid turn about z, which the shape functions hold exactly; with a point mass."""
    a, b, c = 2.0, 0.5, 0.7
    mesh = box(kind, (3, 2, 2), (a, b, c), material=(E, 0.3, RHO))
    corner = int(np.argmax(mesh.position.sum(axis=1)))
    mesh = replace(mesh, point_masses=(PointMass(1, corner, 12.0),))
    x = mesh.position
    stretch, turn = np.zeros_like(x), np.cross([0.0, 0.0, 1.0], x)
    stretch[:, 0] = x[:, 0]
    z = np.column_stack([stretch.ravel(), turn.ravel()])
    found = z.T @ mass_product(mesh, {}, z)
    assert found[0, 0] == pytest.approx(RHO * b * c * a**3 / 3 + 12.0 * a**2, rel=1e-12)
    assert found[1, 1] == pytest.approx(RHO * a * b * c * (a**2 + b**2) / 3 + 12.0 * (a**2 + b**2), rel=1e-12)


@pytest.fixture(scope="module")
def plate():
    """One shell with the nodes on its faces behind its own, and a rigid motion of all."""
    place, steel = lambda a, b: np.column_stack([a, b, 0.2 * b]), Material(1, E, 0.3, RHO)
    mesh = with_faces(sheet("quad4", 1, 1, place, ShellSection(0.05), steel, False))
    u, turn = np.array([0.3, -0.1, 0.7]), np.array([0.2, 0.5, -0.4])
    motion = np.hstack([u + np.cross(turn, mesh.position), np.tile(turn, (len(mesh.position), 1))])
    return mesh, motion


def test_shell_faces_follow_rotations(plate):
    mesh, motion = plate
    known = motion.copy()
    known[mesh.own_nodes :] = np.nan
    found = extend_motion(mesh, known[None])
    assert found.known.all()
    assert np.allclose(found.field[: 3 * len(motion)].reshape(-1, 3), motion[:, :3], atol=1e-14)


def test_results_of_shells_need_rotations(plate):
    mesh, motion = plate
    known = motion[:, :3].copy()
    known[mesh.own_nodes :] = np.nan
    with pytest.raises(UserError, match="use the mesh of the results, and export displacements of all nodes, with"):
        check_rows(mesh, extend_motion(mesh, known[None]))
