"""The thickness of shells as a parameter: K, M and what gauges read, against meshes that are made anew and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.config.loads import LoadSection
from strainsight.errors import UserError
from strainsight.experiment.structure.candidates import rows_along
from strainsight.experiment.structure.references import load_slopes
from strainsight.fem.affine import Parameter
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.fem.recovery import facet_strain, strain_matrix
from strainsight.fem.shells_and_beams import thin_operators
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Material, Region
from strainsight.mesh.properties import value_of, with_value
from strainsight.mesh.thin import BeamSection, GeneralShell, Lamina, Laminate, Ply, ShellSection
from strainsight.mesh.thin_faces import with_faces
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows, fits

from .laminate_models import assert_made_anew
from .shell_models import sheet

E, NU, RHO, T = 7e10, 0.3, 2700.0, 4e-3
FREE = Parameter("t", "thickness", (1,), T, range=(0.6 * T, 1.5 * T))
VALUES = (0.62 * T, 1.07 * T, 1.49 * T)
PLY = Lamina(7, 1.3e11, 9e9, 0.3, 5e9, 4e9, 3e9, 1500.0)
DIAGONALS = [1.0, 0.8, 0.3], [0.1, 0.0, 0.02], [0.9, 0.7, 0.3], [0.3, 0.2]
"""Of membrane, coupling, bending and shear, over E."""
SECTIONS = {
    "homogeneous": ShellSection(T, nonstructural=3.0),
    "of its own bending": ShellSection(T, bending=0.7, shear=0.4),
    "laminate": Laminate((Ply(7, 0.3 * T, 30.0), Ply(7, 0.45 * T, -20.0), Ply(7, 0.25 * T, 80.0)), nonstructural=2.0),
    "general": GeneralShell(T, *(E * np.diag(own) for own in DIAGONALS), RHO, False),
}


def shell(kind="quad4", section=SECTIONS["homogeneous"], height=0.0, offset=0.0, count=(3, 2), size=(0.3, 0.1)):
    """On a rectangle, curved both ways and warped by `height` [m], with the faces of its thickness."""

    def place(a, b):
        return np.column_stack([size[0] * a, size[1] * (b + 0.1 * a * b), height * (a**2 - a * b + 0.4 * b**2)])

    return with_faces(sheet(kind, *count, place, section, Material(1, E, NU, RHO), offset=offset, laminae={7: PLY}))


def anew(mesh, t):
    """Of another thickness, with faces of its own."""
    section = mesh.sections[1]
    if isinstance(section, Laminate):
        plies = tuple(replace(ply, thickness=t / T * ply.thickness) for ply in section.plies)
        changed = replace(section, plies=plies)
    else:
        changed = replace(section, thickness=t)
    bare = replace(
        mesh,
        node_ids=mesh.node_ids[: mesh.own_nodes],
        position=mesh.position[: mesh.own_nodes],
        arms=np.zeros((0, 2), int),
        shells=tuple(replace(own, on_faces=np.zeros((0, 2, 0), int)) for own in mesh.shells),
    )
    return with_faces(replace(bare, sections=dict.fromkeys(mesh.sections, changed)))


@pytest.mark.parametrize(
    ("kind", "section", "height", "offset", "size"),
    [
        ("quad4", "of its own bending", 0.0, 0.0, (0.3, 0.1)),
        ("tri3", "laminate", 0.02, -0.001, (0.3, 0.1)),
        ("quad4", "general", 0.0, 0.001, (0.3, 0.1)),
        ("quad4", "homogeneous", 0.002, 0.0, (0.03, 0.02)),  # about as thick as an element is long
        ("tri3", "homogeneous", 0.002, 0.0, (0.03, 0.02)),
        ("tri6", "homogeneous", 0.02, 0.002, (0.3, 0.1)),
        ("quad8", "laminate", 0.02, -0.001, (0.3, 0.1)),
    ],
)
def test_free_thickness_agrees_with_new_mesh(kind, section, height, offset, size):
    mesh = shell(kind, SECTIONS[section], height, offset, size=size)
    for t, slope in (*((t, np.inf) for t in VALUES), (1.2 * T, 1e-7)):
        assert_made_anew(
            thin_operators(mesh, [FREE]),
            lambda theta: [X.constant for X in thin_operators(anew(mesh, theta["t"]))],
            {"t": t},
            *(1e-8, slope, 1e-5),
        )


def displaced(mesh, t=None):
    """Random motions of the nodes (3n, 4), the same whatever the thickness, with the faces of the mesh."""
    model = build_model(mesh)
    return nodal(model, np.random.default_rng(3).standard_normal((model.size, 4)))


@pytest.mark.parametrize(
    ("kind", "height", "length"),
    [("quad4", 0.02, 0.0), ("tri6", 0.02, 0.0), ("tri3", 0.0, 0.03), ("quad8", 0.0, 0.03)],
)
def test_gauge_readings_agree_with_new_mesh(kind, height, length):
    mesh = shell(kind, height=height, offset=0.001, count=(4, 3))
    facets = exterior_facets(mesh)
    pool = candidates(mesh, facets, (1.0, 0.2, 0.1), (0.0, 50.0), on_constraints=True, length=length)
    pool = pool.take(np.flatnonzero(fits(mesh.position, pool, facets)))
    assert {1.0, -1.0} == set(np.sign(pool.normal[:, 2]))
    field = displaced(mesh)
    rows, change = rows_along(
        mesh, [FREE], lambda own: channel_rows(mesh.position, pool, field, facets=facets, thickness=own)
    )
    np.testing.assert_allclose(rows, channel_rows(mesh.position, pool, field, facets=facets), rtol=1e-12)
    assert (len(change.terms) == 1) == (height == 0)

    def read(t):
        other = anew(mesh, t)
        return channel_rows(other.position, pool, displaced(other), facets=exterior_facets(mesh) if length else None)

    for t in VALUES:
        np.testing.assert_allclose(rows + change.at({"t": t}), read(t), atol=1e-8 * np.abs(rows).max())
    step = 1e-5 * T
    slope = T * (read(0.9 * T + step) - read(0.9 * T - step)) / (2 * step)
    np.testing.assert_allclose(T * change.derivative("t", {"t": 0.9 * T}), slope, atol=1e-7 * np.abs(rows).max())


@pytest.mark.parametrize("kind", ["tri3", "quad8"])
def test_face_strain_agrees_with_new_mesh(kind):
    mesh = shell(kind, height=0.02, count=(4, 3))
    facets, field = exterior_facets(mesh), displaced(mesh)
    rows, change = rows_along(mesh, [FREE], lambda own: strain_matrix(mesh, facets, None, own) @ field)
    for t in VALUES:
        other = anew(mesh, t)
        expected = facet_strain(other, exterior_facets(other)).matrix @ displaced(other)
        np.testing.assert_allclose(rows + change.at({"t": t}), expected, atol=1e-8 * np.abs(rows).max())


def test_of_two_regions_side_by_side_each_moves_its_own_faces():
    mesh = shell(count=(4, 2))
    block = replace(mesh.shells[0], region=np.where(np.arange(8) < 4, 1, 2))
    mesh = replace(
        mesh,
        shells=(block,),
        regions={**mesh.regions, 2: Region(2, "PSHELL 2", 1)},
        sections={1: ShellSection(T), 2: ShellSection(T)},
    )
    facets, field = exterior_facets(mesh), displaced(mesh)
    pool = candidates(mesh, facets, (1.0, 0.2, 0.0), on_constraints=True)
    both = [replace(FREE, name=name, regions=(region,)) for name, region in (("one", 1), ("two", 2))]
    rows, change = rows_along(mesh, both, lambda own: channel_rows(mesh.position, pool, field, thickness=own))
    found = rows + change.at({"one": 1.3 * T, "two": 0.7 * T})
    for region, t in ((1, 1.3 * T), (2, 0.7 * T)):
        other, own = anew(mesh, t), np.isin(pool.element, block.ids[block.region == region])
        expected = channel_rows(other.position, pool, displaced(other))
        np.testing.assert_allclose(found[own], expected[own], atol=1e-9 * np.abs(rows).max())


def test_cantilever_has_the_deflection_frequency_and_strain_of_a_beam_of_that_thickness():
    """w = 4PL³/(E b t³),  f₁ = 1.8751² t/(2πL²) √(E/12ρ),  ε = ±6P(L − x)/(E b t²) on its faces, of ν = 0."""
    length, width = 0.3, 0.03
    mesh = shell(count=(30, 2), size=(length, width))
    x = mesh.position.copy()
    x[:, 1] /= 1 + 0.1 * x[:, 0] / length
    mesh = replace(mesh, position=x, materials={1: Material(1, E, 0.0, RHO)}, sections={1: ShellSection(T)})
    model, facets = build_model(mesh, [FREE]), exterior_facets(mesh)
    tip = np.flatnonzero(np.isclose(mesh.position[: mesh.own_nodes, 0], length))
    push = np.asarray(model.constraint.transform[3 * tip + 2].T @ (np.array([1, 2, 1]) / 4))
    pool = candidates(mesh, facets, (1.0, 0.0, 0.0), on_constraints=True)

    def read(own):
        return channel_rows(mesh.position, pool, nodal(model, np.eye(model.size)), thickness=own)

    rows, change = rows_along(mesh, [FREE], read)
    arm = length - pool.position[:, 0]
    for t in VALUES:
        u = spsolve(model.stiffness.at({"t": t}).tocsc(), push)
        assert push @ u == pytest.approx(4 * length**3 / (E * width * t**3), rel=2e-3)
        first = modes(model.stiffness.at({"t": t}), model.mass.at({"t": t}), 1)[0][0]
        assert first == pytest.approx(1.8751041**2 * t / (2 * np.pi * length**2) * np.sqrt(E / (12 * RHO)), rel=2e-3)
        strain = -np.sign(pool.normal[:, 2]) * 6 * arm / (E * width * t**2)
        np.testing.assert_allclose((rows + change.at({"t": t})) @ u, strain, rtol=2e-3)


def test_load_on_mass_follows_thickness():
    """∂f/∂t of gravity is ρ A in all, whatever mass is not of the material."""
    own = replace(FREE, reference=1.2 * T)
    mesh = with_value(shell(), "thickness", (1,), 1.2 * T)
    model = build_model(replace(mesh, fixed=mesh.fixed[:0]), supported=False)
    load = {"gravity": (0, 0, -1), "known": True, "signal": {"type": "sine", "frequency": 1.0, "amplitude": 9.81}}
    config = {"weight": LoadSection.model_validate(load)}
    slope = load_slopes(model, config, [own])["t"]
    node = np.arange(mesh.own_nodes)
    weight = np.sum(model.constraint.transform[3 * node + 2] @ slope)  # all motions are free
    assert weight == pytest.approx(-RHO * 0.3 * 0.1 * 1.05, rel=1e-9)
    with pytest.raises(UserError, match="depend on the product"):
        load_slopes(model, config, [own, Parameter("rho", "density", (1,), RHO)])


def test_laminate_thickness_is_that_of_all_plies():
    mesh = shell(section=SECTIONS["laminate"])
    assert value_of(mesh, 1, "thickness") == pytest.approx(T)
    changed = with_value(mesh, "thickness", (1,), 2 * T)
    assert [ply.thickness for ply in changed.sections[1].plies] == pytest.approx([0.6 * T, 0.9 * T, 0.5 * T])
    with pytest.raises(UserError, match="consists of solids, which have no thickness") as told:
        value_of(replace(mesh, sections={}), 1, "thickness")
    assert "youngs_modulus" in str(told.value.remedy)
    with pytest.raises(UserError, match="consists of beams or rods, which have no thickness") as told:
        value_of(replace(mesh, sections={1: BeamSection(1e-4)}), 1, "thickness")
    assert "bending_factor" in str(told.value.remedy)
