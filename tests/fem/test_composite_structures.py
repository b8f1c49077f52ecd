"""Structures of composite solids against an element a layer, lamination theory and laminates."""


from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.recovery import facet_strain
from strainsight.fem.stress import surface_model, surface_state
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.sanity import sanity_warnings

from ..anisotropy import CONSTANTS, TURN
from .composite_models import (
    CARBON,
    SKEW,
    STEEL,
    TIN,
    bricks,
    layered,
    moved,
)
from .laminate_models import plate
from .laminate_models import stack as laminate


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_layers_side_by_side_resist_a_pull_with_their_sum(box, kind):
    """Of one Poisson's ratio, F/ε = Σ E_l A_l where nothing holds the sides; the stress of each face is E ε of its layer."""
    mesh = layered(box(kind, (3, 2, 1), size=(1.0, 0.2, 0.1)), [(1.0, STEEL, 0), (3.0, TIN, 0), (1.0, STEEL, 0)])
    x = mesh.position
    corner = {(n, c) for n in np.flatnonzero(x[:, 0] < 1e-9) for c in (0,)}
    corner |= {(n, 1) for n in np.flatnonzero(np.abs(x[:, :2]).max(axis=1) < 1e-9)}
    corner |= {(n, 2) for n in np.flatnonzero(np.abs(x[:, [0, 2]]).max(axis=1) < 1e-9)}
    mesh = replace(mesh, fixed=np.array(sorted(corner)))
    u = x * 1e-3 * [1.0, -0.3, -0.3]
    force = (assemble_stiffness(mesh) @ u.ravel()).reshape(-1, 3)
    end = x[:, 0] > 1 - 1e-9
    assert force[end, 0].sum() == pytest.approx(1e-3 * 0.02 * (0.4 * 2.1e11 + 0.6 * 4.2e10), rel=1e-12)
    np.testing.assert_allclose(moved(mesh, np.where(end[:, None], force, 0.0)), u, atol=1e-14)
    facets = exterior_facets(mesh)
    rows = facet_strain(mesh, facets)
    state = surface_state(surface_model(mesh, rows, u.reshape(-1, 1)), {}, np.ones(1))
    height = x[facets.nodes[:, :4]].mean(axis=1)[:, 2]
    E = np.where((height > 0.02) & (height < 0.08), 4.2e10, 2.1e11)
    np.testing.assert_allclose(state.stress[:, 0], 1e-3 * E, rtol=1e-9)
    assert np.abs(state.stress[:, 1:]).max() < 1e-9 * 2.1e8


def test_layers_one_behind_the_other_are_a_bound_of_their_stiffness(box):
    """Pulled across, one element shares its strain among layers but for what is linear in it, and is between Reuss and Voigt;
    with an element a layer it is Reuss' mean (of ν = 0)."""
    layers = [(1.0, replace(STEEL, poisson_ratio=0.0), 0), (1.0, replace(TIN, poisson_ratio=0.0), 0)]
    found = []
    for mesh in (layered(box("hex8", (1, 1, 1)), layers), bricks(box("hex8", (1, 1, 2)), layers)):
        x = mesh.position
        fixed = np.array(
            [(n, 2) for n in np.flatnonzero(x[:, 2] < 1e-9)] + [(n, c) for n in range(len(x)) for c in (0, 1)]
        )
        force = np.where(x[:, 2:] > 1 - 1e-9, [0.0, 0.0, 0.25], 0.0)
        found.append(1 / moved(replace(mesh, fixed=fixed), force)[:, 2].max())
    reuss, voigt = 2 / (1 / 2.1e11 + 1 / 4.2e10), 0.5 * (2.1e11 + 4.2e10)
    assert found[1] == pytest.approx(reuss, rel=1e-12)
    assert reuss < found[0] < voigt


@pytest.mark.parametrize(("kind", "theory", "explicit"), [("hex8", 0.005, 0.005), ("hex20", 0.01, 0.011)])
def test_a_long_cantilever_bends_as_layered_beam_theory_has_it(box, kind, theory, explicit):
    """3EI/L³ with EI = Σ E_l I_l, skins ten times as stiff as the core; and as the model with an element a layer."""
    layers = [(1.0, STEEL, 0), (8.0, replace(STEEL, youngs_modulus=2.1e10), 0), (1.0, STEEL, 0)]
    tip = []
    for count, make in ((1, layered), (3, bricks)):
        mesh = make(box(kind, (20, 1, count), size=(1.0, 0.05, 0.05), clamp_root=True), layers)
        end = mesh.position[:, :1] > 1 - 1e-9
        force = np.where(end, [0.0, 0.0, 1 / end.sum()], 0.0)
        tip.append(moved(mesh, force)[end[:, 0], 2].mean())
    EI = 0.05 * (2.1e11 * (0.05**3 - 0.04**3) + 2.1e10 * 0.04**3) / 12
    assert tip[0] * 3 * EI == pytest.approx(1.0, rel=theory)
    assert tip[0] == pytest.approx(tip[1], rel=explicit)


def test_a_soft_core_is_too_stiff_in_shear_across_and_import_says_so(box):
    """Skins a hundred times as stiff as the core: Σ sG Σ s/G times what layers with one stress of shear have."""
    layers = [(1.0, STEEL, 0), (8.0, replace(STEEL, youngs_modulus=2.1e9), 0), (1.0, STEEL, 0)]
    mesh = layered(box("hex8", (1, 1, 1)), layers)
    u = (mesh.position[:, 2:] * [1.0, 0.0, 0.0]).ravel()  # γ = 1 in a unit of volume
    G = u @ (assemble_stiffness(mesh) @ u)
    soft = 1 / ((0.2 / 2.1e11 + 0.8 / 2.1e9) * 2.6)
    assert G / soft == pytest.approx((0.2 + 0.008) * (0.2 + 80), rel=1e-9)
    assert any("up to 16.7 times too stiff in shear across" in own for own in sanity_warnings(mesh))
    mild = layered(box("hex8", (1, 1, 1)), [(1.0, CARBON, 0.0), (1.0, CARBON, 90.0)])
    assert not any("in shear across" in own for own in sanity_warnings(mild))


@pytest.mark.parametrize("angles", [(0, 90, 90, 0), (45, -45, -45, 45)])
def test_a_thin_plate_has_the_frequencies_of_the_laminate(box, angles):
    """Clamped at an edge, a hundredth as thick as long: the first six of solids with one element across, and of shells."""
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


def test_rotating_the_model_changes_nothing(box):
    """Frequencies, and the stress on the surface turned with it."""
    layers = [(1.0, CARBON, 30.0), (1.0, SKEW, 0.0), (0.4, TIN, 0.0)]
    mesh = layered(box("hex8", (3, 2, 1), size=(0.5, 0.2, 0.05), distort=0.2, clamp_root=True), layers, 2)
    other = layered(replace(mesh, position=mesh.position @ TURN.T), layers, 2, TURN)
    found = []
    for own in (mesh, other):
        model = build_model(own)
        found.append(modes(model.stiffness.constant, model.mass.constant, 6)[0])
    np.testing.assert_allclose(*found, rtol=1e-10)
    z = np.random.default_rng(0).normal(size=(len(mesh.position), 3))
    facets = exterior_facets(mesh)
    mises = []
    for own, field in ((mesh, z), (other, z @ TURN.T)):
        model = surface_model(own, facet_strain(own, facets), field.reshape(-1, 1))
        mises.append(surface_state(model, {}, np.ones(1)).von_mises)
    np.testing.assert_allclose(*mises, rtol=1e-10)
