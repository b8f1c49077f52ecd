"""Composite solids: the elements, and structures of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.assembly import assemble, assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.nodal_forces import body_forces
from strainsight.fem.patch import Incidence, patch_around
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.mesh.additions import with_material, with_properties
from strainsight.mesh.anisotropic import STACKED, Anisotropic, CompositeSolid, Layer, Orientation, orthotropic
from strainsight.mesh.coordinates import BASIC
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import BodyForce
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import Material
from strainsight.mesh.properties import value_of
from strainsight.mesh.sanity import sanity_warnings
from strainsight.mesh.subdivision import refined
from strainsight.mesh.thin import Lamina
from strainsight.mesh.units import scaled, to_si
from strainsight.records.mesh import MeshColumns
from strainsight.rom.inertia import scalar_mass

from ..anisotropy import CONSTANTS, TURN, strains, tensor, triclinic, turned, work, works_of
from ..bodies import moved
from ..shared import slowly
from .laminate_models import plate
from .laminate_models import stack as laminate

CARBON = Anisotropic(0, orthotropic(*CONSTANTS), 1600.0)
SKEW = Anisotropic(0, triclinic(), 1300.0)
STEEL = Material(0, 2.1e11, 0.3, 7850.0)
TIN = Material(0, 4.2e10, 0.3, 7300.0)
DIRECTIONS = [(kind, along) for kind, each in STACKED.items() for along in each]
SHEARED = np.array([[1, 0.2, 0.1], [0, 1, 0.3], [0.1, 0, 1.0]])


def about(axis, degrees):
    """Axes (3, 3) turned about one of them, 0, 1 or 2."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R, a, b = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
    R[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return R


def layered(mesh, layers, along=2, axes=np.eye(3)):  # noqa: B008
    """All of a mesh of layers (thickness, material, angle), turned about their direction from axes."""
    isotropic, anisotropic, found = {}, {}, []
    for i, (t, own, angle) in enumerate(layers, start=1):
        (anisotropic if isinstance(own, Anisotropic) else isotropic)[i] = replace(own, id=i)
        found.append(Layer(i, t, Orientation(replace(BASIC, axes=np.asarray(axes)), about(along, angle))))
    return replace(
        mesh,
        materials=isotropic,
        anisotropic=anisotropic,
        regions={number: replace(own, material=0) for number, own in mesh.regions.items()},
        composites=dict.fromkeys(mesh.regions, CompositeSolid(tuple(found), along)),
    )


def alone(mesh, own):
    """All of a mesh of one anisotropic material along the basic axes."""
    return replace(mesh, materials={}, anisotropic=dict.fromkeys(mesh.regions, own))


@pytest.mark.parametrize(("kind", "along"), DIRECTIONS)
def test_layers_of_one_material_are_the_element_of_it(box, kind, along):
    straight = box(kind, (2, 2, 2), size=(1.0, 0.7, 0.4))
    straight = replace(straight, position=straight.position @ SHEARED)
    for mesh, layers in ((straight, [1.0, 2.0, 0.7]), (box(kind, (2, 2, 2), distort=0.3), [3.0])):
        many, plain = layered(mesh, [(t, SKEW, 0.0) for t in layers], along), alone(mesh, SKEW)
        check_mesh(many)
        for own, same in zip(assemble(many), assemble(plain), strict=True):
            assert abs(own.constant - same.constant).max() < 2e-15 * abs(same.constant).max()
        facets = exterior_facets(mesh)
        own, same = facet_strain(many, facets), facet_strain(plain, facets)
        assert abs(own.matrix - same.matrix).max() < 1e-14 * abs(same.matrix).max()
        np.testing.assert_allclose(own.laws.stiffness.constant, same.laws.stiffness.constant, rtol=1e-13)


@pytest.mark.parametrize(("kind", "along"), [own for own in DIRECTIONS if own[0] != "hex8"])
def test_a_strain_that_all_layers_share_has_the_work_of_each(box, kind, along):
    """½ ε : Σ V_l C_l : ε, tensors with four indices, turned by the angle of the layer and the axes of the section."""
    layers = [(1.0, CARBON, 20.0), (2.0, STEEL, 0.0), (0.5, SKEW, -70.0)]
    mesh = layered(box(kind, (1, 2, 1), size=(1.0, 0.7, 0.4)), layers, along, TURN)
    G, volume = STEEL.youngs_modulus / 2.6, 0.28
    C = 2 / 3.5 * tensor(G * np.diag([2.0, 2, 2, 1, 1, 1]) + G * 1.5 * np.pad(np.ones((3, 3)), (0, 3)))
    for t, own, angle in (layers[0], layers[2]):
        C = C + t / 3.5 * turned(tensor(own.stiffness), TURN @ about(along, angle))
    works = works_of(assemble_stiffness(mesh), mesh.position)
    np.testing.assert_allclose(works, [volume * work(C, own) for own in strains()], rtol=1e-12)


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_the_direction_counts_as_the_nodes_are_counted(box, kind):
    """The same body whose elements are numbered so that their direction 1, 2 or 3 is upwards: the same matrices."""
    mesh = box(kind, (2, 2, 1), distort=0.2)
    layers = [(1.0, CARBON, 0.0), (2.0, SKEW, 0.0), (0.4, TIN, 0.0)]
    block = mesh.blocks[0]
    first = [own.constant for own in assemble(layered(mesh, layers, 2))]
    reference = kind_of(kind).nodes
    nodes = dict(zip(map(tuple, np.round(reference, 9)), range(len(reference)), strict=True))
    for along in (0, 1):
        turn = np.roll(np.eye(3), along - 2, axis=0)  # new ξ of an old one
        order = [nodes[tuple(np.round(turn.T @ xi, 9))] for xi in reference]
        other = replace(mesh, blocks=(replace(block, nodes=block.nodes[:, order]),))
        for own, same in zip(assemble(layered(other, layers, along, np.eye(3))), first, strict=True):
            assert abs(own.constant - same).max() < 1e-13 * abs(same).max()


@pytest.mark.parametrize("kind", list(STACKED))
def test_mass_lies_where_the_layers_are(box, kind):
    mesh = layered(box(kind, (2, 1, 1), size=(1.0, 0.5, 0.2)), [(1.0, STEEL, 0), (3.0, CARBON, 0)])
    total, centre = mass_properties(mesh)
    weights = 0.1 * np.array([0.25 * 7850.0, 0.75 * 1600.0])
    assert total == pytest.approx(weights.sum(), rel=1e-12)
    np.testing.assert_allclose(centre, [0.5, 0.25, weights @ [0.025, 0.125] / weights.sum()], rtol=1e-12)
    pull = body_forces(mesh, BodyForce(np.array([0.0, 0.0, -9.81])))
    assert pull.force[:, 2].sum() == pytest.approx(-9.81 * total, rel=1e-12)
    lever = mesh.position[pull.nodes, 2] @ pull.force[:, 2]
    assert lever == pytest.approx(-9.81 * total * centre[2], rel=1e-12)
    _, M = assemble(mesh)
    _, free = assemble(mesh, [Parameter("rho", "density", tuple(mesh.regions), 1.0)])
    mean = value_of(mesh, 1, "density")
    assert mean == pytest.approx(0.25 * 7850 + 0.75 * 1600, rel=1e-14)
    assert abs(mean * free.terms["rho"] - M.constant).max() < 1e-14 * abs(M.constant).max()
    assert scalar_mass(mesh).sum() == pytest.approx(total, rel=1e-12)


def test_other_properties_scale_all_layers(box):
    mesh = layered(box("hex8", (1, 1, 1)), [(1.0, STEEL, 0), (3.0, CARBON, 30.0)])
    K, M = (own.constant for own in assemble(mesh))
    other = with_properties(mesh, [1], density=2 * mesh.density_of(1), stiffness_factor=1.5)
    check_mesh(other)
    more, heavier = (own.constant for own in assemble(other))
    assert abs(more - 1.5 * K).max() < 1e-14 * abs(K).max()
    assert abs(heavier - 2 * M).max() < 1e-14 * abs(M).max()
    free, _ = assemble(mesh, [Parameter("s", "stiffness_factor", (1,), 1.0)])
    assert abs(free.terms["s"] - K).max() == 0
    with pytest.raises(
        UserError, match="is a composite solid without isotropic plies: youngs_modulus is undefined"
    ) as e:
        value_of(layered(mesh, [(1.0, CARBON, 0)]), 1, "youngs_modulus")
    assert "stiffness_factor" in e.value.remedy
    with pytest.raises(UserError, match="has no e1"):
        value_of(mesh, 1, "e1")
    with pytest.raises(UserError, match="have 2 isotropic materials") as e:
        value_of(layered(mesh, [(1.0, STEEL, 0), (1.0, TIN, 0)]), 1, "youngs_modulus")
    assert "`material`" in e.value.remedy
    with pytest.raises(UserError, match=r"region .*: the layers have separate materials"):
        with_material(mesh, [1], 2e11, 0.3, 7850.0)


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_the_modulus_of_a_layer_may_be_free(box, kind):
    mesh = layered(box(kind, (2, 1, 1), distort=0.2), [(1.0, CARBON, 20.0), (2.0, STEEL, 0.0), (1.0, TIN, 0.0)])
    E = Parameter("E", "youngs_modulus", (1,), 2.1e11, range=(1.5e11, 3e11), material=2)
    assert value_of(mesh, 1, "youngs_modulus", 2) == 2.1e11
    K, M = assemble(mesh, [E, Parameter("s", "stiffness_factor", (1,), 1.0)])
    assert not M.terms
    free, _ = assemble(mesh, [E])

    def anew(value):
        return replace(mesh, materials={**mesh.materials, 2: replace(mesh.materials[2], youngs_modulus=value)})

    facets = exterior_facets(mesh)
    rows = facet_strain(mesh, facets, [E])
    z = np.random.default_rng(3).normal(size=(3 * len(mesh.position), 1))
    model = surface_model(mesh, rows, z, [E])
    for value in (1.6e11, 2.1e11, 2.9e11):
        same = assemble_stiffness(anew(value))
        d = np.sqrt(same.diagonal())
        for found in (K.at({"E": value, "s": 1.0}), K.at({"E": value, "s": 2.0}) / 2, free.at({"E": value})):
            assert np.abs((found - same).toarray() / np.outer(d, d)).max() < 5e-8
        step = 1e-3 * value
        slope = (assemble_stiffness(anew(value + step)) - assemble_stiffness(anew(value - step))) / (2 * step)
        found = (K.derivative("E", {"E": value, "s": 1.0}) - slope).toarray() * value
        assert np.abs(found / np.outer(d, d)).max() < 5e-6
        stress = surface_state(model, {"E": value}, np.ones(1)).stress
        laws = facet_strain(anew(value), facets).laws
        expected = np.einsum("fij,fj->fi", laws.stiffness.constant, (rows.matrix @ z).reshape(-1, 6))
        np.testing.assert_allclose(stress, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize(("kind", "along"), DIRECTIONS)
def test_halves_of_an_element_have_the_layers_of_their_half(box, kind, along):
    """A mesh cut at the middle of its edges is the same body: Pᵀ X P of the fine matrices, K where no incompatible modes are."""
    layers = [(1.0, CARBON, 20.0), (2.5, STEEL, 0.0), (0.5, SKEW, -70.0)]
    mesh = layered(box(kind, (1, 1, 1), size=(1.0, 0.7, 0.4)), layers, along)
    fine = refined(mesh)
    check_mesh(fine.mesh)
    P = np.kron(fine.interpolation.toarray(), np.eye(3))
    for own, whole in list(zip(assemble(fine.mesh), assemble(mesh), strict=True))[kind == "hex8" :]:
        again = P.T @ (own.constant @ P)
        assert np.abs(again - whole.constant.toarray()).max() < 1e-13 * np.abs(again).max()


def test_it_is_kept_stored_and_resized(box):
    mesh = layered(box("hex8", (2, 1, 1)), [(1.0, STEEL, 0), (3.0, CARBON, 30.0)], 1, TURN)
    stored = MeshColumns.of(mesh).restore()
    assert abs(assemble_stiffness(stored) - assemble_stiffness(mesh)).max() == 0
    assert MeshColumns.of(box("hex8", (1, 1, 1))).composites is None
    larger = scaled(mesh, 2.0)
    K = assemble_stiffness(mesh)
    assert abs(assemble_stiffness(larger) - 2 * K).max() < 1e-14 * abs(K).max()
    patch = patch_around(mesh, Incidence.of(mesh), np.array([0]), 2)
    assert abs(assemble_stiffness(patch.mesh) - assemble_stiffness(mesh)).max() == 0
    in_mm = replace(
        mesh,
        position=1e3 * mesh.position,
        materials={1: replace(mesh.materials[1], youngs_modulus=2.1e5, density=7.85e-9)},
        anisotropic={2: replace(mesh.anisotropic[2], stiffness=1e-6 * CARBON.stiffness, density=1.6e-9)},
    )
    back = to_si(in_mm, "mm", "t")
    for own, same in zip(assemble(back), assemble(mesh), strict=True):
        assert abs(own.constant - same.constant).max() < 1e-12 * abs(same.constant).max()


@pytest.mark.parametrize(
    ("kind", "layers", "along", "what"),
    [
        ("tet4", [(1.0, STEEL, 0)], 2, "tet4 element 1 cannot have layers"),
        ("wedge6", [(1.0, STEEL, 0)], 0, "wedge6 element 1 cannot have layers along its direction 1"),
        ("hex8", [], 2, "without layers"),
        ("hex8", [(0.0, STEEL, 0)], 2, "the thickness 0"),
        ("hex8", [(np.nan, STEEL, 0)], 2, "the thickness nan"),
        ("hex8", [(1.0, replace(STEEL, poisson_ratio=0.5), 0)], 2, "Poisson's ratio 0.5"),
        ("hex8", [(1.0, replace(CARBON, stiffness=np.zeros((6, 6))), 0)], 2, "stiffness matrix is not positive definite"),
    ],
)
def test_what_cannot_be_is_named(box, kind, layers, along, what):
    with pytest.raises(DeckError, match=what) as error:
        check_mesh(layered(box(kind, (1, 1, 1)), layers, along))
    assert error.value.remedy


def test_a_layer_of_no_material_is_named(box):
    mesh = layered(box("hex8", (1, 1, 1)), [(1.0, STEEL, 0), (1.0, TIN, 0)])
    with pytest.raises(DeckError, match=r"a layer of region 1 .* refers to material 2, which does not exist"):
        check_mesh(replace(mesh, materials={1: mesh.materials[1]}))


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_layers_side_by_side_resist_a_pull_with_their_sum(box, kind):
    """Of one Poisson's ratio, F/ε = Σ E_l A_l where nothing holds the sides; the stress of each face is E ε of its layer."""
    mesh = layered(box(kind, (3, 2, 1), size=(1.0, 0.2, 0.1)), [(1.0, STEEL, 0), (3.0, TIN, 0), (1.0, STEEL, 0)])
    x = mesh.position
    u = x * 1e-3 * [1.0, -0.3, -0.3]
    force = (assemble_stiffness(mesh) @ u.ravel()).reshape(-1, 3)
    end = x[:, 0] > 1 - 1e-9
    assert force[end, 0].sum() == pytest.approx(1e-3 * 0.02 * (0.4 * 2.1e11 + 0.6 * 4.2e10), rel=1e-12)
    inner = (x[:, 0] > 1e-9) & ~end
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
    facets = exterior_facets(mesh)
    rows = facet_strain(mesh, facets)
    state = surface_state(surface_model(mesh, rows, u.reshape(-1, 1)), {}, np.ones(1))
    height = x[facets.nodes[:, :4]].mean(axis=1)[:, 2]
    E = np.where((height > 0.02) & (height < 0.08), 4.2e10, 2.1e11)
    np.testing.assert_allclose(state.stress[:, 0], 1e-3 * E, rtol=1e-9)
    assert np.abs(state.stress[:, 1:]).max() < 1e-9 * 2.1e8


@pytest.mark.parametrize(("kind", "theory"), [("hex8", 0.005), ("hex20", 0.01)])
def test_a_long_cantilever_bends_as_layered_beam_theory_has_it(box, kind, theory):
    """3EI/L³ with EI = Σ E_l I_l, skins ten times as stiff as the core."""
    layers = [(1.0, STEEL, 0), (8.0, replace(STEEL, youngs_modulus=2.1e10), 0), (1.0, STEEL, 0)]
    mesh = layered(box(kind, (20, 1, 1), size=(1.0, 0.05, 0.05), clamp_root=True), layers)
    end = mesh.position[:, 0] > 1 - 1e-9
    force = np.where(end[:, None], [0.0, 0.0, 1 / end.sum()], 0.0)
    tip = moved(mesh, force).reshape(-1, 3)[end, 2].mean()
    EI = 0.05 * (2.1e11 * (0.05**3 - 0.04**3) + 2.1e10 * 0.04**3) / 12
    assert tip * 3 * EI == pytest.approx(1.0, rel=theory)


def test_a_soft_core_is_too_stiff_in_shear_across_and_import_reports_it(box):
    """Skins a hundred times as stiff as the core: Σ sG Σ s/G times what layers with one stress of shear have."""
    layers = [(1.0, STEEL, 0), (8.0, replace(STEEL, youngs_modulus=2.1e9), 0), (1.0, STEEL, 0)]
    mesh = layered(box("hex8", (1, 1, 1)), layers)
    u = (mesh.position[:, 2:] * [1.0, 0.0, 0.0]).ravel()  # γ = 1 in a unit of volume
    G = u @ (assemble_stiffness(mesh) @ u)
    soft = 1 / ((0.2 / 2.1e11 + 0.8 / 2.1e9) * 2.6)
    assert G / soft == pytest.approx((0.2 + 0.008) * (0.2 + 80), rel=1e-9)
    assert any("up to 16.7 times too stiff in transverse shear" in own for own in sanity_warnings(mesh))
    mild = layered(box("hex8", (1, 1, 1)), [(1.0, CARBON, 0.0), (1.0, CARBON, 90.0)])
    assert not any("in transverse shear" in own for own in sanity_warnings(mild))


@pytest.mark.parametrize("angles", [*slowly(((0, 90, 90, 0),)), (45, -45, -45, 45)])
def test_a_thin_plate_has_the_frequencies_of_the_laminate(box, angles):
    t = 0.004
    own = layered(box("hex20", (10, 10, 1), size=(0.4, 0.4, t), clamp_root=True), [(1.0, CARBON, a) for a in angles])
    model = build_model(own)
    solid, _ = modes(model.stiffness.constant, model.mass.constant, 6)
    shells = plate(laminate(angles, t / 4), 20, 20, 0.4, 0.4, axis=(1.0, 0.0, 0.0))
    (e1, e2, _), (nu12, _, _), (g12, g13, g23) = CONSTANTS
    root = np.flatnonzero(shells.position[:, 0] < 1e-9)
    shells = replace(
        shells,
        laminae={1: Lamina(1, e1, e2, nu12, g12, g13, g23, 1600.0)},
        fixed=np.array([(n, c) for n in root for c in range(6)]),
    )
    model = build_model(shells)
    thin, _ = modes(model.stiffness.constant, model.mass.constant, 6)
    np.testing.assert_allclose(solid, thin, rtol=0.01)
