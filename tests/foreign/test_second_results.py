"""What a region adds, from two sets of modes and responses: closed form of a stepped bar, projection of a deck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.foreign.imported_modes import Results, extend_motion
from strainsight.foreign.two_result_sets import Change, build_two_set_model
from strainsight.mesh.model import Region

from ..fem.conftest import make_box
from ..shared import slowly

E, RHO, L, A, SIDE, MODES = 2.1e11, 7850.0, 2.0, 0.8, 0.1, 6
LEFT = Parameter("E", "youngs_modulus", (1,), E, range=(0.6 * E, 1.6 * E))
DENSITY = Parameter("rho", "density", (1,), RHO, range=(0.6 * RHO, 1.6 * RHO))
END = (PointLoad("end", (1.0, 0.0, 0.0), node_set="end"),)
NAMES = ("end",)


def with_end(mesh):
    return replace(mesh, node_sets={"end": mesh.node_ids[mesh.position[:, 0] == L]})


@pytest.fixture(scope="module")
def bar():
    """Moves along x alone, as its sections stay plane and ν = 0; region 1 below x = A."""
    material, region = (E, 0.0, RHO), np.repeat([1, 2], [160, 240])
    return with_end(make_box("hex8", (400, 1, 1), (L, SIDE, SIDE), material=material, region=region))


def stepped(count, modulus=E, density=RHO):
    """ω of a bar held at x = 0, of this modulus and density up to x = A and of E and RHO beyond, and its shapes:

    E₁k₁ cos k₁a cos k₂b = E₂k₂ sin k₁a sin k₂b,   k = ω√(ρ/E);   sin k₁x, then c cos k₂(L − x) with
    c cos k₂b = sin k₁a and c sin k₂b = E₁k₁/(E₂k₂) cos k₁a
    """
    slow, fast = np.sqrt(density / modulus), np.sqrt(RHO / E)

    def closes(w):
        left, right = w * slow, w * fast
        return modulus * left * np.cos(left * A) * np.cos(right * (L - A)) - E * right * np.sin(left * A) * np.sin(
            right * (L - A)
        )

    grid = np.linspace(1.0, 80000.0, 8000)
    signs = np.sign([closes(w) for w in grid])
    at = np.flatnonzero(signs[:-1] != signs[1:])[:count]
    omega = np.array([brentq(closes, grid[i], grid[i + 1], xtol=1e-9) for i in at])

    def shapes(x):
        k, q = omega[:, None] * slow, omega[:, None] * fast
        pull = modulus * k / (E * q)
        c = np.sin(k * A) * np.cos(q * (L - A)) + pull * np.cos(k * A) * np.sin(q * (L - A))
        return np.where(x < A, np.sin(k * x), c * np.cos(q * (L - x)))

    return omega, shapes


def set_of(mesh, where="a.frd", **value):
    """Exact modes, of no particular mass, and the exact response to a force at the end."""
    x = mesh.position[:, 0]
    omega, shapes = stepped(MODES, **value)
    static = (np.minimum(x, A) / value.get("modulus", E) + np.maximum(x - A, 0) / E) / SIDE**2
    motion = np.zeros((MODES + 1, len(x), 3))
    motion[:, :, 0] = np.vstack([shapes(x), static])
    steps = tuple(f"{where}, step {i}" for i in range(MODES + 1))
    return motion, Results(omega / (2 * np.pi), np.array([0]), None, 1e-15, steps)


def built(mesh, first, second, change, names=NAMES, loads=END, scaled=None):
    givens, results = zip(*((extend_motion(mesh, motion), own) for motion, own in (first, second)), strict=True)
    return build_two_set_model(mesh, givens, results, lambda model: input_shape(model, loads), names, scaled or {}, change)


def frequencies(model, theta, count=3):
    K, M = (X.at(theta).toarray() for X in (model.stiffness, model.mass))
    return np.sqrt(eigh(K, M, eigvals_only=True)[:count]) / (2 * np.pi)


def test_stepped_bar_interpolates_between_sets(bar):
    """First three frequencies and the static response, from sets at E and 1.4 E; at these two all frequencies."""
    found = built(bar, set_of(bar), set_of(bar, modulus=1.4 * E), Change(LEFT, E, 1.4 * E))
    x = bar.position[:, 0]
    S = input_shape(found.model, END)
    for factor, count in ((1.0, MODES), (1.4, MODES), (1.2, 3), (0.8, 3), (1.6, 3)):
        exact = stepped(count, modulus=factor * E)[0] / (2 * np.pi)
        assert np.allclose(frequencies(found.model, {"E": factor * E}, count), exact, rtol=1e-4, atol=0)
        z = nodal(found.model, np.linalg.solve(found.model.stiffness.at({"E": factor * E}).toarray(), S))[0::3, 0]
        static = (np.minimum(x, A) / (factor * E) + np.maximum(x - A, 0) / E) / SIDE**2
        assert np.allclose(z, static, rtol=0, atol=5e-4 * static.max())
    assert not found.notes or all("normalised" in text for text in found.notes)
    assert not found.alike


def test_stepped_bar_with_density_parameter(bar):
    found = built(bar, set_of(bar), set_of(bar, density=1.4 * RHO), Change(DENSITY, RHO, 1.4 * RHO))
    for factor, count in ((1.0, MODES), (1.4, MODES), (1.2, 3), (0.8, 3), (1.6, 3)):
        exact = stepped(count, density=factor * RHO)[0] / (2 * np.pi)
        assert np.allclose(frequencies(found.model, {"rho": factor * RHO}, count), exact, rtol=1e-4, atol=0)


def test_global_modulus_with_partial_density(bar):
    change = Change(DENSITY, RHO, 1.4 * RHO)
    found = built(bar, set_of(bar), set_of(bar, density=1.4 * RHO), change, scaled={"stiffness": ("all", E)})
    plain = frequencies(found.model, {"rho": RHO, "all": E})
    assert np.allclose(frequencies(found.model, {"rho": RHO, "all": 4 * E}), 2 * plain, rtol=1e-12)


@pytest.fixture(scope="module")
def cantilever():
    """Two materials, ν of the first 0.2."""
    materials, region = {1: (E, 0.2, RHO), 2: (E, 0.3, RHO)}, np.repeat([1, 2], [10, 14])
    return with_end(make_box("hex20", (12, 1, 2), (L, 0.1, 0.14), clamp_root=True, region=region, materials=materials))


def solved(mesh, model, value, count=10):
    """Modes and the response to a force along z at the end, of the deck itself."""
    K, M = model.stiffness.at({"E": value}), model.mass.at({})
    frequency, shapes = modes(K, M, count)
    z = np.linalg.solve(K.toarray(), input_shape(model, BENT))
    motion = np.moveaxis(nodal(model, np.hstack([shapes, z])).reshape(len(mesh.position), 3, -1), 2, 0)
    return motion, Results(frequency, np.array([0]), np.ones(count), 1e-14, tuple(map(str, range(count + 1))))


BENT = (PointLoad("end", (0.0, 0.0, 1.0), node_set="end"),)


@pytest.mark.parametrize("unlike", [*slowly(0.0), 0.1])
def test_two_sets_match_projected_deck(cantilever, unlike):
    """K₁ of the deck on the same coordinates, whose ν nobody states, to 1e-4, most of it in motions of an energy of 1e-8; and
    where the other program's elements of the part differ, some 10 % stiffer and others softer, frequencies to 3e-5."""
    whole = build_model(cantilever, (LEFT,))
    if unlike:
        (block,) = cantilever.blocks
        rng = np.random.default_rng(0)
        moved = {r: replace(cantilever.materials[1], id=r) for r in range(3, 6)}
        region = np.where(block.region == 1, rng.integers(3, 6, len(block.region)), 2)
        E_of = {r: 1 + unlike * (r - 4) for r in moved}
        parts = [Parameter(f"E{r}", "youngs_modulus", (r,), E) for r in moved]
        other = replace(
            cantilever,
            blocks=(replace(block, region=region),),
            regions={r: Region(r, "", r) for r in (2, *moved)},
            materials={2: cantilever.materials[2], **moved},
        )
        apart = build_model(other, parts).stiffness
        K1 = sum(E_of[r] * apart.terms[f"E{r}"] for r in moved)
        whole = replace(whole, stiffness=replace(whole.stiffness, constant=apart.constant, terms={"E": K1}))
    first, second = (solved(cantilever, whole, value) for value in (E, 1.3 * E))
    found = built(cantilever, first, second, Change(LEFT, E, 1.3 * E), loads=BENT)
    assert bool(unlike) == any("does not fit the element formulation" in text for text in found.notes)
    for factor in (0.8, 0.9, 1.15, 1.3, 1.5):
        exact = modes(whole.stiffness.at({"E": factor * E}), whole.mass.at({}), 6)[0]
        assert np.allclose(frequencies(found.model, {"E": factor * E}, 6), exact, rtol=3e-5 if unlike else 6e-6, atol=0)
    if not unlike:
        Psi = found.model.constraint.transform.toarray()
        free = whole.constraint.free_rows
        K1 = Psi[free].T @ (whole.stiffness.terms["E"] @ Psi[free])
        assert np.allclose(found.model.stiffness.terms["E"].toarray(), K1, rtol=0, atol=1e-4 * np.abs(K1).max())


@pytest.mark.parametrize(
    ("first", "second", "change", "said"),
    [
        ({}, {"modulus": 1.4 * E}, Change(LEFT, E, E), r"both result sets have the same value E = 2\.1e\+11"),
        ({}, {}, Change(LEFT, E, 1.4 * E), r"both result sets have the same frequencies: the change of E from 2\.1e\+11"),
        ({}, {"modulus": 0.7 * E}, Change(LEFT, E, 1.4 * E), r"mode 1 changes from 646\.524 to 566\.174 Hz"),
        ({}, {"density": 0.8 * RHO}, Change(LEFT, E, 1.4 * E), r"static response contains mode 1 with the amplitude 6\.8432e-09"),
        ({}, {"modulus": 1.4 * E}, Change(replace(LEFT, regions=(2,)), E, 1.4 * E),
         r"99% of the stiffness difference between the two result sets \(limit 10%\) does not fit isotropic"),
        ({}, {"modulus": 1.4 * E}, Change(LEFT, E, 1.1 * E), r"mode 1 changes from 646\.524 to 722\.244 Hz"),
    ],
)
def test_inconsistent_second_set_is_refused(bar, first, second, change, said):
    with pytest.raises(UserError, match=said) as caught:
        built(bar, set_of(bar, **first), set_of(bar, **second), change)
    assert caught.value.key
    assert caught.value.remedy


def test_a_second_set_with_other_supports_is_refused(bar):
    motion, own = set_of(bar, modulus=1.4 * E)
    held = motion.copy()
    held[:, bar.position[:, 0] == L] = 0.0
    fault = (
        r"node 1601, translation x is fixed in the second result set, but not in the first result set "
        r"\(affected degrees of freedom: 4\)"
    )
    with pytest.raises(UserError, match=fault) as caught:
        built(bar, set_of(bar), (held, own), Change(LEFT, E, 1.4 * E))
    assert "same supports" in caught.value.remedy


def test_two_sets_require_mass(bar):
    light = replace(bar, materials={i: replace(m, density=0.0) for i, m in bar.materials.items()})
    with pytest.raises(UserError, match="two result sets require the mass of the mesh, but a region has no density") as caught:
        built(light, set_of(light), set_of(light, modulus=1.4 * E), Change(LEFT, E, 1.4 * E))
    assert "densities" in caught.value.remedy
