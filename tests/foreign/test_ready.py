"""Ready matrices against the assembly they were taken from, and a beam of two-node elements against its closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.assembly import assemble
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.foreign.imported_matrices import Term, build_imported_model, convert_matrices
from strainsight.mesh.joins import AveragingElement, RigidElement
from strainsight.mesh.model import Mesh

from ..structures import beam_matrices as hermite

E, NU, RHO = 2.1e11, 0.3, 7850.0


def all_rows(mesh):
    """Numbering of three translations a node."""
    return np.repeat(mesh.node_ids, 3), np.tile(np.arange(3), len(mesh.node_ids))


def ready_of(mesh, keep=slice(None), order=slice(None)):
    K, M = (X.at({}) for X in assemble(mesh))
    node, component = (column[keep][order] for column in all_rows(mesh))
    rows = np.arange(K.shape[0])[keep][order]
    return convert_matrices(
        node, component, [Term(sparse.csr_array(K[rows][:, rows]))], [Term(sparse.csr_array(M[rows][:, rows]))]
    )


def tied(box):
    """A clamped box whose end face follows a node in front of it, on which a mass-free averaging node hangs as well."""
    mesh = box("hex8", (4, 2, 2), (1.0, 0.2, 0.3), clamp_root=True)
    face = np.flatnonzero(mesh.position[:, 0] > 1 - 1e-9)
    middle = np.flatnonzero(np.abs(mesh.position[:, 0] - 0.5) < 1e-9)
    n = len(mesh.position)
    return replace(
        mesh,
        node_ids=np.r_[mesh.node_ids, 900, 901] * 3,
        position=np.vstack([mesh.position, [1.1, 0.1, 0.15], [0.5, 0.1, 0.15]]),
        rigid=(RigidElement(1, n, face, (0, 1, 2)),),
        averaging=(AveragingElement(2, n + 1, middle, np.ones(len(middle)), (0, 1, 2, 3, 4, 5)),),
    )


def responses(model):
    """Frequencies and static displacements of all nodes under a force on the tied node."""
    K, M = model.stiffness.at({}), model.mass.at({})
    S = input_shape(
        model, [PointLoad("tip", (0.3, -1.0, 2.0), node_id=2700), PointLoad("mid", (0, 0, 1.0), node_id=2703)]
    )
    z = np.linalg.solve(K.toarray(), S)
    return modes(K, M, 5)[0], nodal(model, z)


@pytest.mark.parametrize("kind", ["all motions", "shuffled", "without clamped", "without clamped and dependent"])
def test_imported_matrices_match_assembly(box, kind):
    mesh = tied(box)
    model = build_model(mesh)
    if kind == "without clamped and dependent":
        # what Nastran's a-set holds: the free motions, the dependent ones condensed into them
        K, M = model.stiffness.at({}), model.mass.at({})
        row = model.constraint.free_rows
        first = model.constraint.reference_rows
        n = len(mesh.position)
        owner = {at + k: (node, 3 + k) for node, at in first.items() for k in range(3)}
        pairs = np.array([(r // 3, r % 3) if r < 3 * n else owner[r] for r in row.tolist()])
        ready = convert_matrices(mesh.node_ids[pairs[:, 0]], pairs[:, 1], [Term(K)], [Term(M)])
    else:
        clamped = np.zeros(3 * len(mesh.position), dtype=bool)
        clamped[3 * mesh.fixed[:, 0] + mesh.fixed[:, 1]] = True
        keep = np.flatnonzero(~clamped) if kind == "without clamped" else np.arange(len(clamped))
        order = np.random.default_rng(0).permutation(len(keep)) if kind == "shuffled" else slice(None)
        ready = ready_of(mesh, keep, order)
    built = build_imported_model(mesh, ready)
    assert built.notes == ()
    assert built.model.size == model.size
    for found, expected in zip(responses(built.model), responses(model), strict=True):
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_rows_without_stiffness_are_left_out(box):
    """Nastran's g-set has six rows a node, and those of the rotations of solids are empty."""
    mesh = tied(box)
    K, M = (X.at({}).tocoo() for X in assemble(mesh))
    size = 6 * len(mesh.node_ids)
    spread = lambda X: sparse.csr_array(  # noqa: E731
        (X.data, (6 * (X.row // 3) + X.row % 3, 6 * (X.col // 3) + X.col % 3)), shape=(size, size)
    )
    node, component = np.repeat(mesh.node_ids, 6), np.tile(np.arange(6), len(mesh.node_ids))
    built = build_imported_model(mesh, convert_matrices(node, component, [Term(spread(K))], [Term(spread(M))]))
    assert built.model.size == build_model(mesh).size
    assert np.allclose(responses(built.model)[0], responses(build_model(mesh))[0], rtol=1e-10)


def test_region_terms_match_assembly(box):
    mesh = box("hex8", (4, 2, 2), clamp_root=True, region=np.repeat([1, 2], 8))
    own = [Parameter("E1", "youngs_modulus", (1,), E), Parameter("rho2", "density", (2,), RHO)]
    expected = build_model(mesh, own)
    K, M = assemble(mesh, own)
    node, component = all_rows(mesh)
    ready = convert_matrices(
        node,
        component,
        # one term as it was made at 2.1e11 Pa, the other with unit density
        [Term(K.constant), Term(K.terms["E1"] * E, "E1", E)],
        [Term(M.constant), Term(M.terms["rho2"], "rho2")],
    )
    found = build_imported_model(mesh, ready).model
    theta = {"E1": 1.7e11, "rho2": 7000.0}
    assert ready.at == {"E1": E, "rho2": 1.0}
    for X, Y in ((found.stiffness, expected.stiffness), (found.mass, expected.mass)):
        assert abs(X.at(theta) - Y.at(theta)).max() <= 1e-12 * abs(Y.at(theta)).max()


def test_one_parameter_has_one_value():
    one = Term(sparse.csr_array(np.eye(1)), "E", 2.0)
    with pytest.raises(UserError, match="the matrices of parameter E have different values of `at`: 2 and 1"):
        convert_matrices(np.array([1]), np.array([0]), [one, replace(one, at=1.0)], [])


# --- a beam along x, six motions a node, its stiffness and mass from a textbook ---

LENGTH, WIDTH, HEIGHT = 2.0, 0.03, 0.05
AREA, IY, IZ = WIDTH * HEIGHT, WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12


def beam_matrices(elements, length=LENGTH, modulus=E, density=RHO, area=AREA, iy=IY, iz=IZ):
    """Euler-Bernoulli elements: K, M (6 n, 6 n), rows 6 node + component; a rotation about y goes with −dw/dx."""
    h = length / elements
    size = 6 * (elements + 1)
    K, M = np.zeros((size, size)), np.zeros((size, size))
    G, J = modulus / (2 * (1 + NU)), iy + iz
    bar, barm = np.array([[1, -1], [-1, 1]]) / h, np.array([[2, 1], [1, 2]]) * h / 6
    bend, inert = (own[0] for own in hermite(1, h, 1.0, 1.0))
    turn = np.diag([1.0, -1.0, 1.0, -1.0])
    for e in range(elements):
        a, b = 6 * e, 6 * e + 6
        for dofs, k, m in (
            ([a, b], modulus * area * bar, density * area * barm),
            ([a + 3, b + 3], G * J * bar, density * J * barm),
            ([a + 1, a + 5, b + 1, b + 5], modulus * iz * bend, density * area * inert),
            ([a + 2, a + 4, b + 2, b + 4], modulus * iy * turn @ bend @ turn, density * area * turn @ inert @ turn),
        ):
            K[np.ix_(dofs, dofs)] += k
            M[np.ix_(dofs, dofs)] += m
    return sparse.csr_array(K), sparse.csr_array(M)


def beam_mesh(elements, clamped=True) -> Mesh:
    """Nodes only."""
    n = elements + 1
    position = np.zeros((n, 3))
    position[:, 0] = np.linspace(0, LENGTH, n)
    fixed = np.array([(0, c) for c in range(6)]) if clamped else np.zeros((0, 2), dtype=int)
    return Mesh(np.arange(1, n + 1), position, (), fixed)


def beam_rows(mesh):
    return np.repeat(mesh.node_ids, 6), np.tile(np.arange(6), len(mesh.node_ids))


BETA_L = np.array([1.8751040687, 4.6940911330, 7.8547574382])


def closed_form(inertia):
    return (BETA_L / LENGTH) ** 2 * np.sqrt(E * inertia / (RHO * AREA)) / (2 * np.pi)


def test_beam_matrices_match_closed_form():
    mesh = beam_mesh(20)
    K, M = beam_matrices(20)
    built = build_imported_model(mesh, convert_matrices(*beam_rows(mesh), [Term(K)], [Term(M)]))
    assert built.notes == ()
    expected = np.sort(np.r_[closed_form(IY), closed_form(IZ)])[:5]
    found = modes(built.model.stiffness.at({}), built.model.mass.at({}), 5)[0]
    assert np.allclose(found, expected, rtol=2e-5)


def test_matrices_are_independent_of_units():
    mesh = beam_mesh(6)
    si = build_imported_model(mesh, convert_matrices(*beam_rows(mesh), *([Term(X)] for X in beam_matrices(6))))
    deck = beam_matrices(6, 1e3 * LENGTH, E * 1e-6, RHO * 1e-12, AREA * 1e6, IY * 1e12, IZ * 1e12)
    ready = convert_matrices(*beam_rows(mesh), *([Term(X)] for X in deck), 1e-3, 1e3)
    mm = build_imported_model(mesh, ready)
    for X, Y in ((mm.model.stiffness, si.model.stiffness), (mm.model.mass, si.model.mass)):
        difference = abs(X.at({}) - Y.at({})).toarray()
        assert np.all(difference <= 1e-12 * np.abs(Y.at({}).toarray()) + 1e-12 * np.abs(Y.at({})).max() * 1e-6)


def test_matrix_components_are_along_nodal_axes():
    mesh = beam_mesh(5)
    K, M = beam_matrices(5)
    rng = np.random.default_rng(0)
    axes = {i: np.linalg.qr(rng.standard_normal((3, 3)))[0] for i in range(1, 6)}
    R = sparse.block_diag([np.eye(6), *(np.kron(np.eye(2), axes[i].T) for i in range(1, 6))], format="csr")
    plain = build_imported_model(mesh, convert_matrices(*beam_rows(mesh), [Term(K)], [Term(M)])).model
    turned = build_imported_model(
        replace(mesh, axes=axes),
        convert_matrices(*beam_rows(mesh), *([Term(sparse.csr_array(R @ X @ R.T))] for X in (K, M))),
    ).model
    load = [PointLoad("tip", (1.0, 2.0, 3.0), node_id=6)]
    z = [nodal(m, np.linalg.solve(m.stiffness.at({}).toarray(), input_shape(m, load))) for m in (plain, turned)]
    assert np.allclose(z[1], z[0], rtol=1e-9, atol=1e-9 * np.abs(z[0]).max())


def test_nodal_axis_without_stiffness_is_left_out():
    mesh = beam_mesh(5)
    K, M = beam_matrices(5)
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    rows = np.delete(np.arange(36), 6 * 5 + 3)
    R = sparse.block_diag([np.eye(30), np.kron(np.eye(2), Q.T)], format="csr")
    # in turned axes, drop the torsional-like third rotation of the tip
    cut = [sparse.csr_array((R @ X @ R.T).tocsr()[rows][:, rows]) for X in (K, M)]
    node, component = (column[rows] for column in beam_rows(mesh))
    built = build_imported_model(replace(mesh, axes={5: Q}), convert_matrices(node, component, *([Term(X)] for X in cut)))
    clamped = rows[rows >= 6]
    expected = np.linalg.eigvals(
        np.linalg.solve(
            (R @ M @ R.T).toarray()[np.ix_(clamped, clamped)], (R @ K @ R.T).toarray()[np.ix_(clamped, clamped)]
        )
    )
    found = modes(built.model.stiffness.at({}), built.model.mass.at({}), 4)[0]
    assert built.model.size == len(clamped)
    assert np.allclose(found, np.sqrt(np.sort(expected.real)[:4]) / (2 * np.pi), rtol=1e-8)


def test_missing_nodes_and_free_motions_are_refused():
    mesh = beam_mesh(4)
    K, M = beam_matrices(4)
    node, component = beam_rows(mesh)
    with pytest.raises(DeckError, match=r"row 8 of the matrices belongs to node 77, which is not in the mesh \(aff") as caught:
        build_imported_model(
            mesh,
            convert_matrices(np.where(np.arange(30) == 7, 77, node), component, [Term(K)], [Term(M)], source="r.csv"),
        )
    assert caught.value.where == "r.csv:9"
    with pytest.raises(UserError, match=r"can move freely \(translation x, translation y, translation z, rotation about x"):
        build_imported_model(beam_mesh(4, False), convert_matrices(node, component, [Term(K)], [Term(M)]))


def test_partial_support_is_detected():
    mesh = beam_mesh(4)
    K, M = beam_matrices(4)
    ready = convert_matrices(*beam_rows(mesh), [Term(K)], [Term(M)])
    hinged = np.array([(0, c) for c in (0, 1, 2, 3, 5)])
    with pytest.raises(UserError, match="rigid-body motions: 1"):
        build_imported_model(replace(mesh, fixed=hinged), ready)
    beyond = replace(mesh, node_ids=np.r_[mesh.node_ids, 9], position=np.vstack([mesh.position, [0, 0, 1.0]]))
    with pytest.raises(UserError, match="translation x, translation y"):
        build_imported_model(replace(beyond, fixed=np.array([(5, c) for c in range(3)])), ready)
    one = np.array([(n, c) for n in range(5) for c in range(6) if (n, c) != (4, 2)])
    assert build_imported_model(replace(mesh, fixed=one), ready).model.size == 1


def test_supports_inside_matrices_are_noted():
    mesh = beam_mesh(4, False)
    K, M = beam_matrices(4)
    node, component = beam_rows(mesh)
    reduced = convert_matrices(node[6:], component[6:], [Term(K[6:, 6:])], [Term(M[6:, 6:])])
    assert "the imported stiffness matrix prevents all rigid-body motions" in build_imported_model(mesh, reduced).notes[0]
    springs = sparse.csr_array(K + sparse.diags_array(np.tile([1e2] * 6, 5)))
    note = build_imported_model(mesh, convert_matrices(node, component, [Term(springs)], [Term(M)])).notes[0]
    mass = RHO * AREA * LENGTH
    assert f"{np.sqrt(5e2 / mass) / (2 * np.pi):.2g}" in note


def test_nonpositive_diagonal_is_refused():
    mesh = beam_mesh(3)
    K, M = beam_matrices(3)
    K = K.tolil()
    K[13, 13] = -1.0
    with pytest.raises(DeckError, match="node 3, translation y: the diagonal entry of the stiffness matrix is -1"):
        build_imported_model(mesh, convert_matrices(*beam_rows(mesh), [Term(sparse.csr_array(K))], [Term(M)]))


def test_lost_mass_and_unmoved_solids_are_noted(box):
    mesh = box("hex8", (3, 2, 2), clamp_root=True)
    inner = np.flatnonzero(np.all(np.abs(mesh.position - 0.5) < 0.4, axis=1))
    assert len(inner) == 2
    K, M = (X.at({}) for X in assemble(mesh))
    node, component = all_rows(mesh)
    rows = np.flatnonzero(~np.isin(node, mesh.node_ids[inner]))
    built = build_imported_model(
        mesh,
        convert_matrices(node[rows], component[rows], [Term(K[rows][:, rows])], [Term(M[rows][:, rows])]),
    )
    assert "translations: 6; nodes: 2, ids" in built.notes[0]
    assert ", ".join(map(str, mesh.node_ids[inner])) in built.notes[0]
    soft = K.tolil()
    gone = np.flatnonzero(np.isin(node, mesh.node_ids[inner]))
    soft[gone], soft[:, gone] = 0, 0
    built = build_imported_model(mesh, convert_matrices(node, component, [Term(sparse.csr_array(soft))], [Term(M)]))
    assert (
        f"matrix rows with mass but without stiffness are omitted (6 in total), for example node {mesh.node_ids[inner[0]]}"
        in built.notes[1]
    )
