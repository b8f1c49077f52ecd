"""Factors of the sections of beams and rods as parameters: against beam theory, and sections made anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.cases.structure.settings import load_slopes
from strainsight.config.loads import Load
from strainsight.errors import UserError
from strainsight.fem.affine import Parameter
from strainsight.fem.model import build_model
from strainsight.fem.thin import thin_operators
from strainsight.mesh.properties import with_value
from strainsight.mesh.thin import BeamSection

from .test_thin import BAR, NU, RHO, E, L, straight

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


def test_each_factor_acts_on_its_own_motion_and_exactly():
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
        return thin_operators(replace(mesh, sections={1: changed}, materials={1: material}))

    for which, X in enumerate((K, M)):
        at = X.at(theta).toarray()
        d = np.sqrt(np.diag(at))
        scale = np.outer(d, d) + (np.outer(d, d) == 0)
        assert np.abs((at - anew(theta)[which].at({}).toarray()) / scale).max() < 5e-8
        for name, value in theta.items():
            step = 1e-4 * value
            up, down = (anew({**theta, name: value + k * step})[which].at({}) for k in (1, -1))
            slope = value * (X.derivative(name, theta) - (up - down) / (2 * step)).toarray()
            assert np.abs(slope / scale).max() < 1e-6


def test_load_on_mass_follows_the_area():
    """Under its own weight the tip moves by ρ A f_A L⁴/(8 E I): the slope in f_A; the density beside it is refused."""
    own = replace(free("area_factor")[0], reference=1.2)
    model = build_model(with_value(straight(section=BAR), "area_factor", (1,), 1.2))
    load = {"gravity": (0, 0, -1), "known": True, "signal": {"type": "sine", "frequency": 1.0, "amplitude": 9.81}}
    config = {"weight": Load.model_validate(load)}
    slope = load_slopes(model, config, [own])["area_factor"]
    tip = model.constraint.transform[3 * 10 + 2] @ spsolve(model.stiffness.at({}).tocsc(), slope[:, 0])
    assert tip == pytest.approx(-RHO * A * L**4 / (8 * E * I2), rel=2e-3)
    with pytest.raises(UserError, match="multiply each other"):
        load_slopes(model, config, [own, Parameter("rho", "density", (1,), RHO)])


def test_factor_of_what_a_section_lacks_is_refused():
    rod = straight(section=BeamSection(area=1e-4), kind="rod")
    for name in ("bending_factor", "torsion_factor"):
        with pytest.raises(UserError, match=f"no stiffness of its own that a {name}"):
            thin_operators(rod, free(name))
    K, _ = thin_operators(rod, free("area_factor"))
    np.testing.assert_allclose(K.at({"area_factor": 1.3}).toarray(), 1.3 * K.constant.toarray(), rtol=1e-12)
