"""Stiffness and mass: exact where they must be, equal to another library's; affine operators and their sums."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from strainsight import memory
from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator, Coefficient, Newton, Parameter, sum_of
from strainsight.fem.assembly import assemble
from strainsight.fem.mass import mass_properties
from strainsight.mesh.joins import PointMass
from strainsight.mesh.kinds import ELEMENTS

KINDS = [kind.name for kind in ELEMENTS]
E, NU, RHO = 2.1e11, 0.3, 7850.0


def constant_stress(gradient, modulus=E, nu=NU):
    strain = 0.5 * (gradient + gradient.T)
    return modulus / (1 + nu) * (strain + nu / (1 - 2 * nu) * np.trace(strain) * np.eye(3)), strain


@pytest.mark.parametrize("kind", KINDS)
def test_patch_test_on_distorted_elements(box, kind):
    """A linear field has no internal forces at inner nodes and the energy ½ σ:ε V."""
    mesh = box(kind, (3, 3, 3), distort=0.3)
    K = assemble(mesh)[0].constant
    gradient = np.random.default_rng(3).normal(size=(3, 3))
    u = (mesh.position @ gradient.T).ravel()
    force = K @ u
    inner = np.repeat(np.all((mesh.position > 1e-9) & (mesh.position < 1 - 1e-9), axis=1), 3)
    stress, strain = constant_stress(gradient)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
    assert u @ force == pytest.approx(np.sum(stress * strain), rel=1e-12)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("kind", KINDS)
def test_only_rigid_motions_have_no_energy(box, kind, unit):
    mesh = box(kind, (1, 2, 1), size=(unit, unit, unit), distort=0.2)
    K = assemble(mesh)[0].constant
    x = mesh.position / unit
    rigid = np.column_stack([np.tile(e, len(x)) for e in np.eye(3)] + [np.cross(e, x).ravel() for e in np.eye(3)])
    assert np.abs(K @ rigid).max() < 1e-12 * np.abs(K).max()
    stiffness = np.linalg.eigvalsh(K.toarray()) / np.abs(K).max()
    assert np.all(stiffness[:6] < 1e-12)
    assert stiffness[6] > 1e-4


@pytest.mark.parametrize("kind", KINDS)
def test_mass_of_rigid_motions_is_that_of_the_body(box, kind):
    mesh = box(kind, (2, 3, 2), size=(1.0, 2.0, 0.5), distort=0.0)
    M = assemble(mesh)[1].constant
    spin = np.cross([0, 0, 1.0], mesh.position).ravel()
    assert spin @ M @ spin == pytest.approx(RHO * 1.0 * (1.0**2 + 2.0**2) / 3, rel=1e-13)
    mass, at = mass_properties(mesh)
    assert mass == pytest.approx(RHO, rel=1e-13)
    assert np.allclose(at, [0.5, 1.0, 0.25], atol=1e-13)


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex20", "hex8"])
def test_matrices_equal_those_of_scikit_fem(box, kind):
    """Stiffness (hex8 apart, whose incompatible modes scikit-fem lacks) and mass on affine elements, to 1e-12."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    shear = np.array([[1.0, 0.2, 0.1], [0.0, 1.1, 0.3], [0.05, 0.0, 0.9]])
    mesh = box(kind, (2, 2, 2), distort=0.2 if kind.startswith("tet") else 0.0)
    mesh = replace(mesh, position=mesh.position @ shear.T)
    cells = mesh.blocks[0].nodes
    corners = 4 if kind.startswith("tet") else 8
    used, local = np.unique(cells[:, :corners], return_inverse=True)
    local = local.reshape(-1, corners)
    if corners == 4:
        other, element = (
            skfem.MeshTet(mesh.position[used].T, local.T),
            skfem.ElementTetP1() if kind == "tet4" else skfem.ElementTetP2(),
        )
    else:
        order = [0, 1, 3, 4, 2, 5, 7, 6]
        other = skfem.MeshHex(mesh.position[used].T, local[:, order].T)
        element = skfem.ElementHex1() if kind == "hex8" else skfem.ElementHexS2()
    basis = skfem.Basis(other, skfem.ElementVector(element), intorder=6)
    dofs, places = [basis.nodal_dofs], [other.p]
    if kind in ("tet10", "hex20"):
        dofs.append(basis.edge_dofs)
        places.append(other.p[:, other.edges].mean(axis=1))
    dofs, places = np.hstack(dofs), np.hstack(places).T
    match = np.argmin(np.linalg.norm(mesh.position[:, None] - places[None], axis=2), axis=1)
    rows = dofs[:, match].T.ravel()

    @skfem.BilinearForm
    def inertia(u, v, w):
        return RHO * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])

    K, M = (operator.constant.toarray() for operator in assemble(mesh))
    K_other = linear_elasticity(*lame_parameters(E, NU)).assemble(basis).toarray()[np.ix_(rows, rows)]
    M_other = inertia.assemble(basis).toarray()[np.ix_(rows, rows)]
    assert np.abs(M - M_other).max() < 1e-12 * np.abs(M).max()
    if kind == "hex8":
        softer = np.linalg.eigvalsh(K_other - K)
        assert softer.min() > -1e-12 * np.abs(K).max()
        assert softer.max() > 0.01 * np.abs(K).max()
    else:
        assert np.abs(K - K_other).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_one_layer_of_bricks_bends_exactly(box, kind):
    """Pure bending of a bar, u = κ(−xz, νyz, (x² + ν(z² − y²))/2): energy ½EIκ²L, Poisson effect included."""
    L, b, h = 2.0, 0.7, 0.3
    mesh = box(kind, (2, 1, 1), size=(L, b, h))
    x, y, z = mesh.position.T - np.array([[L / 2], [b / 2], [h / 2]])
    curvature = 1e-3
    u = curvature * np.column_stack([-x * z, NU * y * z, 0.5 * (x**2 + NU * (z**2 - y**2))]).ravel()
    energy = 0.5 * u @ assemble(mesh)[0].constant @ u
    assert energy == pytest.approx(0.5 * E * b * h**3 / 12 * curvature**2 * L, rel=1e-11)


def two_regions(box, kind):
    region = np.tile(np.repeat([1, 2], 8), 6 if kind.startswith("tet") else 1)
    return box(kind, (4, 2, 2), distort=0.2, region=region, materials={1: (E, NU, RHO), 2: (E, 0.2, 2700.0)})


@pytest.mark.parametrize("kind", ["tet10", "hex8"])
def test_affine_operators_equal_direct_assembly_at_any_parameter(box, kind):
    mesh = two_regions(box, kind)
    mesh = replace(mesh, point_masses=(PointMass(1, 3, 12.5),))
    parameters = [Parameter("E1", "youngs_modulus", (1,), 2e11), Parameter("rho2", "density", (2,), 2700.0)]
    K, M = assemble(mesh, parameters)
    for theta in ({"E1": 1.3e11, "rho2": 1000.0}, {"E1": 7.0, "rho2": 0.0}):
        materials = {
            1: replace(mesh.materials[1], youngs_modulus=theta["E1"]),
            2: replace(mesh.materials[2], density=theta["rho2"]),
        }
        K_direct, M_direct = assemble(replace(mesh, materials=materials))
        assert np.abs((K.at(theta) - K_direct.constant).toarray()).max() < 1e-13 * np.abs(K_direct.constant).max()
        assert np.abs((M.at(theta) - M_direct.constant).toarray()).max() < 1e-13 * np.abs(M_direct.constant).max()
    assert set(K.terms) == {"E1"}
    assert set(M.terms) == {"rho2"}


def test_one_parameter_over_two_regions_keeps_each_poisson_ratio(box):
    mesh = two_regions(box, "tet4")
    K = assemble(mesh, [Parameter("E", "youngs_modulus", (1, 2), 2e11)])[0]
    assert K.constant.nnz == 0
    assert np.abs((K.at({"E": E}) - assemble(mesh)[0].constant).toarray()).max() < 1e-13 * E


def reordered(mesh, element, order):
    """One element with its nodes in another order."""
    (block,) = mesh.blocks
    nodes = block.nodes.copy()
    nodes[element] = nodes[element][[*order, *range(len(order), nodes.shape[1])]]
    return replace(mesh, blocks=(replace(block, nodes=nodes),))


def with_swapped_middles(mesh):
    """The last two nodes of the second element swapped: its Jacobian may stay positive at every quadrature point."""
    size = mesh.blocks[0].nodes.shape[1]
    return reordered(mesh, 1, [*range(size - 2), size - 1, size - 2])


def with_material(mesh, **change):
    return replace(mesh, materials={1: replace(mesh.materials[1], **change)})


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("wedge6", lambda mesh: reordered(mesh, 0, [3, 4, 5, 0, 1, 2]), r"inverted wedge6 elements \(1 in total\): 1 "),
        ("wedge6", lambda mesh: replace(mesh, position=mesh.position * [1, 1, 0]), r"inverted wedge6 elements \(4 in total\)"),
        ("tet4", lambda mesh: reordered(mesh, 1, [1, 0]), r"inverted tet4 elements \(1 in total\): 2 "),
        ("hex8", lambda mesh: reordered(mesh, 1, [1, 0]), r"inverted hex8 elements \(1 in total\): 2 "),
        *((kind, with_swapped_middles, f"{kind} element 2 ") for kind in ("tet10", "hex20", "wedge15")),
        ("tet4", lambda mesh: with_material(mesh, youngs_modulus=0.0), "Young's modulus"),
        ("tet4", lambda mesh: with_material(mesh, youngs_modulus=np.nan), "Young's modulus"),
        ("tet4", lambda mesh: with_material(mesh, poisson_ratio=0.5), "Poisson"),
        ("tet4", lambda mesh: with_material(mesh, density=-1.0), "density"),
        ("tet4", lambda mesh: replace(mesh, regions={}), "region 1"),
        ("tet4", lambda mesh: replace(mesh, materials={}), "material 1"),
    ],
)
def test_invalid_meshes_are_refused(box, kind, change, message):
    with pytest.raises(DeckError, match=message):
        assemble(change(box(kind, (2, 1, 1))))


def test_a_mesh_without_mass_is_refused(box):
    with pytest.raises(DeckError, match="total mass is 0 kg"):
        mass_properties(with_material(box("tet4", (1, 1, 1)), density=0.0))


E_OF, RHO_OF = (Parameter("E", name, (1,), 1.0) for name in ("youngs_modulus", "density"))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ([replace(E_OF, regions=(9,))], "region 9"),
        ([E_OF, RHO_OF], "the parameter name 'E' is empty or is used more than once"),
        ([E_OF, replace(E_OF, name="F")], "both define the youngs_modulus"),
    ],
)
def test_conflicting_parameters_are_refused(box, parameters, message):
    with pytest.raises(UserError, match=message):
        assemble(box("tet4", (1, 1, 1)), parameters)


@pytest.mark.parametrize("kind", KINDS)
def test_too_little_memory_for_the_sum_is_refused_and_enough_is_not(box, kind, monkeypatch):
    mesh = box(kind, (4, 4, 4))
    assemble(mesh)  # what the first call leaves behind is not the assembly's
    tracemalloc.start()
    assemble(mesh)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    monkeypatch.setattr(memory, "available_memory", lambda: float(peak))
    assemble(mesh)
    monkeypatch.setattr(memory, "available_memory", lambda: peak / 20)
    words = rf"the stiffness matrix of a mesh with {len(mesh.position)} nodes: .* GiB of memory are needed"
    with pytest.raises(UserError, match=words):
        assemble(mesh)


rng = np.random.default_rng(0)
X0, X1, X3, XE = rng.standard_normal((4, 3, 3))
PLATE = AffineOperator(
    X0,
    {"E": XE, "E t": X1, "E t^3": X3},
    {
        "E t": Coefficient((Newton("t", (0.0,), 2.0),), np.array([0.0, 1.0])).times("E"),
        "E t^3": Coefficient(
            (Newton("E"), Newton("t", (1.0, 0.0, -0.5), 2.0)), np.array([[0.0, 0, 0, 0], [0, 3.0, 0, 8.0]])
        ),
    },
)


def written_out(E, t):
    return X0 + E * XE + E * t / 2 * X1 + E * (3 * (t - 1) / 2 + (t - 1) * t * (t + 0.5)) * X3


def test_value_is_the_polynomial():
    assert PLATE.parameters == ("E", "t")
    np.testing.assert_allclose(PLATE.at({"E": 3.0, "t": 0.7}), written_out(3.0, 0.7), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("t", [0.7, 1.0, 0.0, -0.5])
def test_derivatives_are_those_of_a_complex_step(t):
    np.testing.assert_allclose(
        PLATE.derivative("t", {"E": 3.0, "t": t}), written_out(3.0, t + 1e-30j).imag / 1e-30, rtol=1e-13, atol=1e-14
    )
    np.testing.assert_allclose(
        PLATE.derivative("E", {"E": 3.0, "t": t}), written_out(3.0 + 1e-30j, t).imag / 1e-30, rtol=1e-13, atol=1e-14
    )
    assert not PLATE.derivative("rho", {"E": 3.0, "t": t}).any()


def test_affine_operator_broadcasts_over_values():
    E, t = rng.uniform(1, 2, (2, 4)), rng.uniform(0.5, 1.5, (2, 4))
    X, slope = PLATE.at({"E": E, "t": t}), PLATE.derivative("t", {"E": E, "t": t})
    assert X.shape == slope.shape == (2, 4, 3, 3)
    for i in np.ndindex(2, 4):
        np.testing.assert_allclose(X[i], PLATE.at({"E": E[i], "t": t[i]}), rtol=1e-14)
        np.testing.assert_allclose(slope[i], PLATE.derivative("t", {"E": E[i], "t": t[i]}), rtol=1e-14)
    for some in (2.0, E[0]):  # one for all, and one for all of an axis
        values = {"E": np.broadcast_to(some, (2, 4)), "t": t}
        np.testing.assert_allclose(PLATE.at({"E": some, "t": t}), PLATE.at(values), rtol=1e-14)


@pytest.mark.parametrize("logarithm", [False, True])
def test_polynomial_levels_off_outside_its_range(logarithm):
    own = Newton("t", (0.0, 0.0, 0.0), 1.0, (0.5, 2.0), 0.1, logarithm)
    t = np.array([1e-5, 0.45, 0.5, 1.0, 2.0, 2.1, 90.0])
    seen = np.array([0.45, 0.5 - 0.05 * np.tanh(1), 0.5, 1.0, 2.0, 2 + 0.2 * np.tanh(0.5), 2.2])
    x, by_x = (np.log(seen), 1 / t) if logarithm else (seen, np.ones(7))
    N, slope = own.at({"t": t})
    np.testing.assert_allclose(N, [x**k for k in range(4)], rtol=1e-7, atol=1e-12)
    d = 1e-6
    differences = (own.at({"t": t + d})[0] - own.at({"t": t - d})[0]) / (2 * d)
    np.testing.assert_allclose(slope, differences, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(slope[3, 2:5], (3 * x**2 * by_x)[2:5], rtol=1e-14)


def test_sums_and_maps_go_term_by_term():
    theta = {"E": 3.0, "t": 0.7}
    both = sum_of(PLATE, AffineOperator(X1, {"E": X3, "t": X0}))
    np.testing.assert_allclose(both.at(theta), PLATE.at(theta) + X1 + 3 * X3 + 0.7 * X0, rtol=1e-13, atol=1e-14)
    Psi = rng.standard_normal((3, 2))
    symmetric = PLATE.of_all(lambda X: X + X.T)
    np.testing.assert_allclose(
        symmetric.project(Psi).at(theta), Psi.T @ symmetric.at(theta) @ Psi, rtol=1e-12, atol=1e-13
    )


def test_zero_constant_with_sparse_terms():
    term = sparse.csr_array(np.diag([1.0, 2.0]))
    np.testing.assert_array_equal(AffineOperator(0.0, {"a": term}).at({"a": 2.0}).toarray(), np.diag([2.0, 4.0]))


N = 12


def some(seed: int, density: float) -> sparse.csr_array:
    own = sparse.random_array((N, N), density=density, rng=np.random.default_rng(seed), format="csr")
    own.sort_indices()
    return sparse.csr_array(own)


def test_an_operator_on_one_pattern_has_the_values_it_had():
    first = some(0, 0.4)
    X = AffineOperator(first, {"a": some(1, 0.5), "b": -1.0 * first, "c": some(2, 0.02)})
    wide = X.on_one_pattern()
    assert np.shares_memory(wide.terms["a"].indices, wide.constant.indices)
    assert wide.terms["c"].nnz == X.terms["c"].nnz
    for theta in ({"a": 0.0, "b": 1.0, "c": 0.0}, {"a": 2.5, "b": -0.3, "c": 7.0}):
        dense = X.constant.toarray() + sum(value * X.terms[name].toarray() for name, value in theta.items())
        for own in (X, wide):
            assert np.allclose(own.at(theta).toarray(), dense, rtol=1e-13, atol=1e-15)
    assert np.array_equal(wide.constant.toarray(), first.toarray())


def test_operator_does_not_depend_on_evaluated_values():
    X = AffineOperator(some(0, 0.4), {"a": some(1, 0.5)}).on_one_pattern()
    before = X.constant.toarray()
    X.at({"a": 2.0}).data[:] = 0.0
    assert np.array_equal(X.constant.toarray(), before)


@pytest.mark.parametrize("empty", [0, 1])
def test_a_sum_with_an_empty_operator_is_the_other_one(empty):
    nothing, own = AffineOperator(sparse.csr_array((N, N)), {}), AffineOperator(some(0, 0.4), {"a": some(1, 0.5)})
    both = sum_of(own, nothing) if empty else sum_of(nothing, own)
    assert np.array_equal(both.at({"a": 2.0}).toarray(), own.at({"a": 2.0}).toarray())
