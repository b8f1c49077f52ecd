"""Moduli of plies and factors of sections as parameters: against meshes and sections made anew, and beam theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.config.loads import LoadSection
from strainsight.errors import UserError
from strainsight.experiment.structure.damage import surface_places
from strainsight.experiment.structure.references import load_slopes
from strainsight.fem.affine import Parameter
from strainsight.fem.model import build_model
from strainsight.fem.recovery import facet_strain, surface_model, surface_state
from strainsight.fem.shells_and_beams import thin_operators
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Region
from strainsight.mesh.properties import value_of, with_value
from strainsight.mesh.thin import BeamSection, Lamina, ShellSection
from strainsight.mesh.thin_faces import with_faces

from .laminate_models import CARBON, STEEL, assert_made_anew, plate, stack
from .test_thin import BAR, NU, RHO, E, L, straight

ANY = stack([10, 55, -70, 0], [1e-3, 2e-4, 5e-4, 7e-4], [1, 2, 1, 1])
SANDWICH = stack([0, 0, 90], [1e-3, 2e-2, 1e-3], [1, 3, 1])
GLASS = Lamina(9, 4.0e10, 8.0e9, 0.28, 4.0e9, 3.5e9, 3.0e9, 1900.0, "glass")


def moduli(*names, low=0.75, high=1.3, own=CARBON, material=None, prefix=""):
    """Parameters of these names over a range about the moduli of a lamina."""
    return [
        Parameter(prefix + name, name, (1,), v, range=(low * v, high * v), material=material)
        for name, v in ((name, getattr(own, name)) for name in names)
    ]


def distorted(laminate, kind="quad4"):
    mesh = plate(laminate, 3, 2, 0.3, 0.25, kind, axis=(1.0, 0.3, 0.0), offset=1e-3)
    mesh.position[5, :2] += (0.02, 0.013)
    return mesh


def apart(X, Y):
    """max |X − Y|_ij/√(Y_ii Y_jj)."""
    d = np.sqrt(Y.diagonal())
    return float(np.abs((X - Y).toarray() / np.outer(d, d)).max())


@pytest.mark.parametrize(
    ("kind", "laminate", "names"),
    [
        ("quad4", ANY, ("e1", "e2", "g12")),
        ("quad4", SANDWICH, ("g1z", "g2z")),
        ("tri3", SANDWICH, ("e1",)),
        ("tri3", ANY, ("g1z", "g2z")),
        ("quad8", ANY, ("g12",)),
        ("tri6", SANDWICH, ("g1z", "g2z")),
    ],
)
def test_stiffness_agrees_with_new_plies(kind, laminate, names):
    mesh, free = distorted(laminate, kind), moduli(*names)
    K, M = thin_operators(mesh, free)
    assert not M.terms
    reference = {own.name: own.reference for own in free}

    def anew(theta):
        return [thin_operators(replace(mesh, laminae={1: replace(CARBON, **theta)}))[0].at({})]

    assert abs(K.at(reference) - anew(reference)[0]).max() <= 1e-15 * abs(K.constant).max() * len(K.terms)
    rng = np.random.default_rng(1)
    for _ in range(2):
        assert_made_anew([K], anew, {own.name: rng.uniform(*own.range) for own in free})


def test_stiffness_stays_positive_definite_however_far_a_filter_tries():
    mesh = distorted(ANY)
    free = moduli("e1", "e2", "g12")
    K, _ = thin_operators(mesh, free)
    rng = np.random.default_rng(2)
    for scale in np.exp(rng.uniform(-10, 10, (8, 3))):
        X = K.at({own.name: factor * own.reference for own, factor in zip(free, scale, strict=True)}).toarray()
        d = np.sqrt(np.diag(X))
        assert np.linalg.eigvalsh(X / np.outer(d, d))[0] > -1e-10


def test_factor_multiplies_stiffness_of_free_plies():
    mesh = distorted(ANY)
    free = [*moduli("e1"), Parameter("s", "stiffness_factor", (1,), 1.0)]
    K, _ = thin_operators(mesh, free)
    theta = {"e1": 1.5e11, "s": 0.8}
    other = replace(
        mesh,
        laminae={1: replace(CARBON, e1=1.2e11, **{name: 0.8 * getattr(CARBON, name) for name in ("e2", "g12", "g1z", "g2z")})},
        materials={2: replace(STEEL, youngs_modulus=0.8 * STEEL.youngs_modulus)},
    )  # fmt: skip
    assert apart(K.at(theta), thin_operators(other)[0].at({})) < 5e-8
    np.testing.assert_allclose((0.8 * K.derivative("s", theta) - K.at(theta)).toarray(), 0, atol=1e-9 * abs(K.at(theta)).max())


def test_stress_of_the_outer_plies_follows_their_moduli_and_so_does_its_deviation():
    mesh = with_faces(plate(ANY, 2, 2, 0.3, 0.25, axis=(1.0, 0.3, 0.0)))
    free, facets = moduli("e1", "g12"), exterior_facets(mesh)
    field = np.random.default_rng(3).normal(size=(3 * len(mesh.position), 2))
    q, theta = np.array([1.0, -0.5]), {"e1": 1.2e11, "g12": 5.5e9}
    own = surface_model(mesh, facet_strain(mesh, facets, free), field, free)

    def anew(values):
        other = replace(mesh, laminae={1: replace(CARBON, **values)})
        return surface_state(surface_model(other, facet_strain(other, facets), field), {}, q)

    std = np.array([1e10, 4e8])
    state = surface_state(own, theta, q, np.diag([0, 0, *std**2]), ("e1", "g12"))
    expected = anew(theta)
    for name in ("stress", "von_mises"):
        scale = np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(state, name), getattr(expected, name), atol=1e-7 * scale)
    rows = surface_places(own, np.zeros((len(state.stress), 3)), facets.element_id).rows.at(theta)
    np.testing.assert_allclose(rows @ q, expected.stress, atol=1e-7 * np.abs(expected.stress).max())
    spread = []
    for name, s in zip(("e1", "g12"), std, strict=True):
        d = 1e-4 * theta[name]
        up, down = (anew({**theta, name: theta[name] + k * d}).stress for k in (1, -1))
        spread.append((up - down) / (2 * d) * s)
    np.testing.assert_allclose(
        state.stress_std, np.linalg.norm(spread, axis=0), rtol=1e-4, atol=1e-6 * np.abs(spread).max()
    )


def test_material_selects_plies():
    mixed = stack([0, 45, 90], 1e-3, [1, 9, 1])
    mesh = replace(plate(mixed, 2, 1, 0.3, 0.25), laminae={1: CARBON, 9: GLASS})
    assert value_of(mesh, 1, "e1", "glass") == value_of(mesh, 1, "e1", 9) == GLASS.e1
    other = with_value(mesh, "e1", (1,), 5e10, "glass")
    assert [value_of(other, 1, "e1", name) for name in (1, "glass")] == [CARBON.e1, 5e10]
    free = [*moduli("e1", material=1), *moduli("e1", own=GLASS, material="glass", prefix="glass ")]
    K, _ = thin_operators(mesh, free)
    anew = replace(mesh, laminae={1: replace(CARBON, e1=1.5e11), 9: replace(GLASS, e1=3.5e10)})
    assert apart(K.at({"e1": 1.5e11, "glass e1": 3.5e10}), thin_operators(anew)[0].at({})) < 5e-8


def test_modulus_of_isotropic_plies_is_shared_with_plate():
    mesh = plate(stack([10, 55, 0], 1e-3, [2, 1, 1]), 4, 2, 0.4, 0.2, axis=(1.0, 0.3, 0.0))
    mesh.shells[0].region[:4] = 2
    mesh = replace(
        mesh, regions={**mesh.regions, 2: Region(2, "PSHELL 2", 2)}, sections={**mesh.sections, 2: ShellSection(2e-3)}
    )
    free, theta = [Parameter("E", "youngs_modulus", (1, 2), 2.0e11, range=(1.6e11, 2.6e11))], {"E": 2.3e11}
    K, _ = thin_operators(mesh, free)
    anew = replace(mesh, materials={2: replace(STEEL, youngs_modulus=2.3e11)})
    assert apart(K.at(theta), thin_operators(anew)[0].at({})) < 5e-8
    states = []
    for own, parameters in ((with_faces(mesh), free), (with_faces(anew), [])):
        facets = exterior_facets(own)
        z = np.random.default_rng(4).normal(size=3 * len(own.position))
        states.append(
            surface_state(surface_model(own, facet_strain(own, facets, parameters), z, parameters), theta, np.ones(1))
        )
    np.testing.assert_allclose(states[0].stress, states[1].stress, atol=1e-7 * np.abs(states[1].stress).max())


@pytest.mark.parametrize("kind", ["quad4", "tri3"])
def test_bending_of_a_homogeneous_shell_has_a_factor(kind):
    """That of 12 I/t³: K is that of a section made anew."""
    mesh = plate(ANY, 6, 2, 0.3, 0.05, kind)
    mesh = replace(mesh, sections={1: ShellSection(1e-3)}, regions={1: Region(1, "PSHELL 1", 2)})
    free = [Parameter("f", "bending_factor", (1,), 1.0, range=(0.7, 1.4))]
    for f in (0.7, 1.15):
        other = replace(mesh, sections={1: replace(mesh.sections[1], bending=f)})
        assert apart(thin_operators(mesh, free)[0].at({"f": f}), thin_operators(other)[0].at({})) < 5e-8


@pytest.mark.parametrize(
    ("property", "material", "laminate", "what"),
    [
        ("e1", None, stack([0, 45], 1e-3, [1, 9]), "2 orthotropic materials"),
        ("e1", "glas", stack([0, 45], 1e-3, [1, 9]), "no orthotropic material 'glas'"),
        ("e1", None, stack([0, 45], 1e-3, 2), "without orthotropic plies"),
        ("torsion_factor", None, ANY, "not consist of beams"),
        ("bending_factor", None, ANY, "not consist of beams or homogeneous shells"),
        ("area_factor", None, ANY, "not consist of beams or rods"),
    ],
)
def test_what_a_region_does_not_have_is_refused(property, material, laminate, what):
    mesh = replace(plate(laminate, 1, 1, 1.0, 1.0), laminae={1: CARBON, 9: GLASS})
    with pytest.raises(UserError, match=what) as error:
        thin_operators(mesh, [Parameter("p", property, (1,), 1.0, range=(0.8, 1.2), material=material)])
    assert error.value.remedy


def test_two_parameters_of_one_property_are_refused():
    with pytest.raises(UserError, match="a and b both define the e1"):
        thin_operators(distorted(ANY), [replace(moduli("e1")[0], name=name) for name in "ab"])


A, I1, I2, J, G = BAR.area, BAR.second[0, 0], BAR.second[1, 1], BAR.torsion, E / (2 * (1 + NU))
PULL, PUSH, TWIST = (np.eye(6)[k] for k in (0, 1, 3))


def free(*properties, low=0.6, high=1.7):
    return [Parameter(name, name, (1,), 1.0, range=(low, high)) for name in properties]


def tip_of(model, theta, load):
    """Displacement and rotation (6,) of the tip under a unit force or moment there."""
    rows = model.constraint.reference_rows
    tip = 10
    at = np.concatenate([3 * tip + np.arange(3), rows[tip] + np.arange(3)])
    T = model.constraint.transform[at]
    return T @ spsolve(model.stiffness.at(theta).tocsc(), T.T @ load)


def test_each_factor_acts_alone_motion_and_exactly():
    """u = PL/(EA), v = PL³/(3EI₁), φ = ML/(GJ), each over its factor; affine, so that one term each is enough."""
    model = build_model(straight(section=BAR), free("area_factor", "bending_factor", "torsion_factor"))
    assert len(model.stiffness.terms) <= 3
    rng = np.random.default_rng(0)
    for a, b, t in ((1, 1, 1), *rng.uniform(0.6, 1.7, (3, 3))):
        theta = {"area_factor": a, "bending_factor": b, "torsion_factor": t}
        assert tip_of(model, theta, PULL)[0] == pytest.approx(L / (E * A * a), rel=1e-9)
        assert tip_of(model, theta, PUSH)[1] == pytest.approx(L**3 / (3 * E * I1 * b), rel=1e-9)
        assert tip_of(model, theta, TWIST)[3] == pytest.approx(L / (G * J * t), rel=1e-9)


@pytest.mark.parametrize("shear", [(0.0, 0.0), (0.8, 0.7)])
def test_stiffness_and_mass_are_those_of_a_section_made_anew(shear):
    section = BeamSection(
        2e-3, np.array([[8e-7, 1e-7], [1e-7, 6e-7]]), 3e-7, shear, nonstructural=0.4,
        at_b=BeamSection(1e-3, np.array([[4e-7, 0.0], [0.0, 5e-7]]), 2e-7, shear, nonstructural=0.2),
    )  # fmt: skip
    mesh = straight(count=3, section=section, offset=(0.0, 0.01, 0.02))
    own = [*free("area_factor", "bending_factor", "torsion_factor"), Parameter("E", "youngs_modulus", (1,), E)]
    K, M = thin_operators(mesh, [*own, Parameter("rho", "density", (1,), RHO)])
    theta = {"area_factor": 1.4, "bending_factor": 0.7, "torsion_factor": 1.2, "E": 1.1e11, "rho": 7000.0}

    def anew(theta):
        def times(end):
            return replace(
                end,
                area=theta["area_factor"] * end.area,
                second=theta["bending_factor"] * end.second,
                torsion=theta["torsion_factor"] * end.torsion,
            )

        changed = replace(times(section), at_b=times(section.at_b))
        material = replace(mesh.materials[1], youngs_modulus=theta["E"], density=theta["rho"])
        return [X.at({}) for X in thin_operators(replace(mesh, sections={1: changed}, materials={1: material}))]

    assert_made_anew((K, M), anew, theta)


def test_load_on_mass_follows_the_area():
    """Under its own weight the tip moves by ρ A f_A L⁴/(8 E I): the slope in f_A; the density beside it is refused."""
    own = replace(free("area_factor")[0], reference=1.2)
    model = build_model(with_value(straight(section=BAR), "area_factor", (1,), 1.2))
    load = {"gravity": (0, 0, -1), "known": True, "signal": {"type": "sine", "frequency": 1.0, "amplitude": 9.81}}
    config = {"weight": LoadSection.model_validate(load)}
    slope = load_slopes(model, config, [own])["area_factor"]
    tip = model.constraint.transform[3 * 10 + 2] @ spsolve(model.stiffness.at({}).tocsc(), slope[:, 0])
    assert tip == pytest.approx(-RHO * A * L**4 / (8 * E * I2), rel=2e-3)
    with pytest.raises(UserError, match="depend on the product"):
        load_slopes(model, config, [own, Parameter("rho", "density", (1,), RHO)])


def test_factor_of_what_a_section_lacks_is_refused():
    rod = straight(section=BeamSection(area=1e-4), kind="rod")
    for name in ("bending_factor", "torsion_factor"):
        with pytest.raises(UserError, match=f"{name} scales a stiffness .* does not have"):
            thin_operators(rod, free(name))
    K, _ = thin_operators(rod, free("area_factor"))
    np.testing.assert_allclose(K.at({"area_factor": 1.3}).toarray(), 1.3 * K.constant.toarray(), rtol=1e-12)
