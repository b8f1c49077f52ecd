"""The hub of meshes/: a curved solid against closed forms, CalculiX on the same mesh, and itself."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.decks.reader import read_mesh
from strainsight.fem.assembly import assemble
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes

MESHES = Path(__file__).parents[2] / "meshes"
R, WALL, FLANGE, FACE, BORE, RHO = 0.5, 0.15, -0.315, 0.43, 0.15, 7100.0
FACES = ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9))
"""Corners of a tet10's faces, outward, and their mid-side nodes."""


@pytest.fixture(scope="module")
def hub():
    return read_mesh(MESHES / "hub-coarse.bdf.gz")


@pytest.fixture(scope="module")
def lowest(hub):
    """Model, frequencies and shapes; more modes than are compared, so that the last ones can mix too."""
    model = build_model(hub)
    return model, *modes(model.stiffness.constant, model.mass.constant, 16)


@pytest.mark.slow
def test_the_deck_is_the_one_in_the_list_of_checksums(hub):
    listed = dict(reversed(line.split()) for line in (MESHES / "hub.sha256").read_text().splitlines())
    assert set(listed) == {"hub-coarse.bdf.gz", "hub.bdf.gz"}
    for name, digest in listed.items():
        assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == digest
    assert hub.ignored == {"EIGRL": 1}
    assert [len(hub.node_sets[f"SET1-{number}"]) for number in (21, 22, 23)] == [len(hub.rigid[1].nodes)] * 3


@pytest.mark.slow
def test_ten_frequencies_do_not_change(lowest):
    """This package's own values; the last test holds them against CalculiX."""
    stored = [
        484.72281295,
        496.25552504,
        1010.3602084,
        1048.6246228,
        1465.2015064,
        1669.3525529,
        1743.8480254,
        1804.2779057,
        2183.7456549,
        2209.087058,
    ]
    assert np.allclose(lowest[1][:10], stored, rtol=1e-9)


@pytest.mark.slow
def test_rigid_motions_take_no_energy(hub):
    """rᵀKr against Σ k_ii r_i², for three translations and three rotations about the centre of mass."""
    K = assemble(hub)[0].constant
    x = hub.position - mass_properties(hub)[1]
    translations = np.tile(np.eye(3), (len(x), 1))
    rotations = np.stack([np.cross(axis, x).ravel() for axis in np.eye(3)], axis=1)
    motions = np.hstack([translations, rotations])
    energy = np.einsum("ij,ij->j", motions, K @ motions)
    assert np.all(np.abs(energy) <= 1e-12 * (K.diagonal() @ motions**2))


def surface_volume(mesh):
    """V = ⅓ ∮ x·n dA over the faces that belong to one element, each a curved triangle of six nodes.

    The integrand is a polynomial of degree 4 on the triangle: three Gauss points each way in ξ, η = (1 − ξ)t are exact.
    """
    faces = np.concatenate([mesh.blocks[0].nodes[:, list(face)] for face in FACES])
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    p = mesh.position[faces[first[count == 1]]]
    points, weights = np.polynomial.legendre.leggauss(3)
    points, weights = 0.5 * (points + 1), 0.5 * weights
    volume = 0.0
    for xi, a in zip(points, weights, strict=True):
        for t, b in zip(points, weights, strict=True):
            eta = (1 - xi) * t
            L = np.array([1 - xi - eta, xi, eta])
            dL = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
            N = np.concatenate([L * (2 * L - 1), 4 * L * np.roll(L, -1)])
            dN = np.hstack([dL * (4 * L - 1), 4 * (dL * np.roll(L, -1) + L * np.roll(dL, -1, axis=1))])
            x, along, across = (np.einsum("i,fik->fk", n, p) for n in (N, *dN))
            volume += a * b * (1 - xi) / 3 * np.sum(x * np.cross(along, across))
    return volume


def solid_volume():
    """Spherical shell less three flat faces with their bores and less what the shaft's flange cuts off."""

    def cap(radius, height):
        return np.pi * height**2 * (radius - height / 3)

    r = R - WALL
    ball = 4 / 3 * np.pi * (R**3 - r**3)
    bore = np.pi * BORE**2 * FACE - 2 / 3 * np.pi * (r**3 - (r**2 - BORE**2) ** 1.5)
    return ball - 3 * (cap(R, R - FACE) + bore) - (cap(R, R + FLANGE) - cap(r, r + FLANGE))


@pytest.mark.slow
def test_mass_is_density_times_volume(hub):
    """The volume inside the surface of the mesh, by the divergence theorem; and that of the solid, by formulae, which
    straight sides would miss by 4e-4."""
    mass, centre = mass_properties(hub)
    assert mass == pytest.approx(RHO * surface_volume(hub), rel=1e-12)
    assert mass == pytest.approx(RHO * solid_volume(), rel=2e-6)
    assert np.all(np.abs(centre[:2]) < 1e-6)


def four_point_mass(mesh, fields):
    """ΦᵀMΦ (r, r) of nodal fields (n, 3, r) with the rule of degree 2 that CalculiX uses for a C3D10's mass.

    It is not exact even on straight elements, where NᵀN has degree 4; this package's is.
    """
    dL = np.array([[-1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0]])
    first, second = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]).T
    nodes, near = mesh.blocks[0].nodes, (5 + 3 * np.sqrt(5)) / 20
    M = np.zeros((fields.shape[2],) * 2)
    for corner in range(4):
        L = np.full(4, (1 - near) / 3)
        L[corner] = near
        N = np.concatenate([L * (2 * L - 1), 4 * L[first] * L[second]])
        dN = np.hstack([dL * (4 * L - 1), 4 * (dL[:, first] * L[second] + dL[:, second] * L[first])])
        J = np.einsum("di,eik->edk", dN, mesh.position[nodes])
        u = np.einsum("i,eikr->ekr", N, fields[nodes])
        M += RHO / 24 * np.einsum("e,ekr,eks->rs", np.linalg.det(J), u, u, optimize=True)
    return M


def calculix_deck(mesh):
    """The whole deck in CalculiX's words: clamped nodes held one by one, the rigid face u = U + θ × r as equations."""
    block, material = mesh.blocks[0], mesh.materials[1]
    clamp, load = mesh.rigid
    turn, centre = int(mesh.node_ids.max()) + 1, int(mesh.node_ids[load.reference])
    lines = ["*NODE"]
    lines += [f"{i},{x:.12g},{y:.12g},{z:.12g}" for i, (x, y, z) in zip(mesh.node_ids, mesh.position, strict=True)]
    lines += [f"{turn},0,0,0", "*ELEMENT,TYPE=C3D10,ELSET=ALL"]
    lines += [",".join(map(str, (e, *n))) for e, n in zip(block.ids, mesh.node_ids[block.nodes], strict=True)]
    lines += ["*MATERIAL,NAME=IRON", "*ELASTIC", f"{material.youngs_modulus},{material.poisson_ratio}"]
    lines += ["*DENSITY", f"{material.density}", "*SOLID SECTION,ELSET=ALL,MATERIAL=IRON"]
    lines += ["*BOUNDARY", *(f"{mesh.node_ids[n]},1,3" for n in clamp.nodes), "*EQUATION"]
    for n in load.nodes:
        x, y, z = mesh.position[n] - mesh.position[load.reference]
        for component, arm in enumerate(((0, z, -y), (-z, 0, x), (y, -x, 0)), start=1):
            terms = [(mesh.node_ids[n], component, 1.0), (centre, component, -1.0)]
            terms += [(turn, k, -a) for k, a in enumerate(arm, start=1) if a]
            lines += [str(len(terms)), ",".join(f"{node},{c},{value:.12g}" for node, c, value in terms)]
    return "\n".join([*lines, "*STEP", "*FREQUENCY", "10", "*END STEP", ""])


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
def test_ten_frequencies_against_calculix_on_the_same_mesh(hub, lowest, tmp_path):
    """To six digits with CalculiX's rule for the mass, to 1e-5 with this package's; it prints seven digits of ω²."""
    model, frequency, shapes = lowest
    (tmp_path / "hub.inp").write_text(calculix_deck(hub))
    subprocess.run(["ccx", "hub"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL, timeout=900)
    rows = [line.split() for line in (tmp_path / "hub.dat").read_text().splitlines()]
    table = [float(row[1]) for row in rows if len(row) == 5 and row[0].isdigit()]
    calculix = np.sqrt(table[:10]) / (2 * np.pi)
    assert np.allclose(frequency[:10], calculix, rtol=1e-5)
    M = four_point_mass(hub, nodal(model, shapes).reshape(len(hub.position), 3, -1))
    same_rule = np.sqrt(eigh(np.diag(frequency**2), M, eigvals_only=True))
    assert np.allclose(same_rule[:10], calculix, rtol=5e-7)
