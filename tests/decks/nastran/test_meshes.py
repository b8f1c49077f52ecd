"""The committed meshes: what their scripts write, what they weigh, and how the parts of the hinge hold each other."""

from __future__ import annotations

import gzip
import hashlib
import runpy

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import UserError
from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.thin_faces import with_faces, with_sides
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.zones import NormalCone

from ...shared import ROOT
from ..programs import frequencies

MESHES = ROOT / "meshes"


@pytest.fixture(scope="module")
def mesh():
    return with_sides(with_faces(read_mesh(MESHES / "hinge.bdf.gz", "mm", "t")))


@pytest.fixture(scope="module")
def model(mesh):
    return build_model(mesh)


@pytest.fixture(scope="module")
def static(model):
    """Displacements (3n, 3) under a newton along x, y and z at the pin."""
    loads = [PointLoad(name, tuple(axis), node_id=2) for name, axis in zip("xyz", np.eye(3), strict=True)]
    return nodal(model, factorise(model.stiffness.constant).solve(input_shape(model, loads)))


@pytest.mark.slow
def test_frequencies_match_mystran_within_0_85_percent(model):
    """MYSTRAN 18.0, solids of reduced integration, RBE3 of rotations as MPC, mass and inertia of bars as CONM2."""
    mystran = [584.17, 618.12, 1041.87, 1063.38, 1491.65, 1712.67, 1754.53, 1899.09, 1906.33, 2046.19]
    frequency, _ = modes(model.stiffness.constant, model.mass.constant, 10)
    np.testing.assert_allclose(frequency, mystran, rtol=0.0085)
    # as its README states
    np.testing.assert_allclose(frequency[:3], [584.4, 618.6, 1045.3], rtol=2e-3)


def membrane():
    """A [N/m] of the web, quasi-isotropic: invariants of its ply (Tsai and Pagano 1968)."""
    E1, E2, nu12, G = 140e9, 9e9, 0.3, 5e9
    Q11, Q22 = np.array([E1, E2]) / (1 - nu12**2 * E2 / E1)
    Q12 = nu12 * Q22
    U1, U4 = (3 * Q11 + 3 * Q22 + 2 * Q12 + 4 * G) / 8, (Q11 + Q22 + 6 * Q12 - 4 * G) / 8
    return 3e-3 * np.array([[U1, U4, 0], [U4, U1, 0], [0, 0, (U1 - U4) / 2]])


@pytest.fixture(scope="module")
def readings(mesh, static):
    """(which gauges: 3 of the web, 4 of the stiffeners, else 0; facet, place (g, 3), strain (g, 3 angles, 3 loads))."""
    ends = [NormalCone((side, 0, 0), 15.0) for side in (1, -1)]
    gauges = candidates(mesh, exterior_facets(mesh), (1, 0, 0), (0.0, 45.0, 90.0), ends, on_constraints=True)
    thin = {
        id: region for block in (*mesh.shells, *mesh.beams) for id, region in zip(block.ids, block.region, strict=True)
    }
    read = channel_rows(mesh.position, gauges, static).reshape(-1, 3, 3)
    return np.array([thin.get(id, 0) for id in gauges.element[::3]]), gauges.facet[::3], gauges.position[::3], read


def ordered(place):
    return np.lexsort((place[:, 1].round(6), place[:, 0].round(6)))


@pytest.mark.slow
@pytest.mark.parametrize("along", [0, 1])
def test_gauges_on_web_and_stiffeners_balance_pin_force(readings, along):
    """Around the fitting, along a rectangle through centres of elements: N = A ε of the middle of the web, the mean of its
    faces, and E A ε of the middle of the stiffeners that cross it, the mean of their upper and lower side."""
    part, facet, place, read = readings
    across = np.array([130.5e-3, 112.5e-3])
    faces = []
    for face, sense in ((UPPER, 1), (LOWER, -1)):
        own = np.flatnonzero((part == 3) & (facet == face))
        own = own[ordered(place[own])]
        e0, e45, e90 = read[own, :, along].T
        faces.append(np.column_stack([e0, e90, sense * (2 * e45 - e0 - e90)]))
    x, y = place[own, :2].T
    N = (faces[0] + faces[1]) / 2 @ membrane()
    outside = [np.isclose(np.abs(own), edge) for own, edge in zip((x, y), across, strict=True)]
    inside = [np.abs(own) < edge + 1e-6 for own, edge in zip((x, y), across, strict=True)]
    corner = np.where(outside[0] & outside[1], 0.5, 1.0)
    # 9 mm of the line; on the sides across x the force is (N_x, N_xy), on those across y (N_xy, N_y)
    first, second = N[:, [[0, 2][along], [2, 1][along]]].T * corner * 9e-3
    carried = np.sum((np.sign(x) * first)[outside[0] & inside[1]]) + np.sum(
        (np.sign(y) * second)[outside[1] & inside[0]]
    )
    if along == 0:
        bars = (part == 4) & (np.abs(place[:, 1]) < across[1]) & np.isclose(np.abs(place[:, 0]), across[0])
        sides = bars & (np.isclose(place[:, 2], -1.5e-3) | np.isclose(place[:, 2], -25.5e-3))
        assert np.sum(sides) == 2 * 4 * 2
        carried += 71e9 * 96e-6 / 2 * np.sum(np.sign(place[sides, 0]) * read[sides, 0, along])
    assert carried == pytest.approx(-1.0, rel=0.005)


def strip_on_a_block(file, tied):
    """Model and top nodes of a strip of shells, 60 × 30 × 3 mm, edge-on on a block of steel, its top pushed by 1 N."""
    blocks = [(i, j, k) for i in range(6) for j in range(7) for k in range(3)]
    node = {}

    def solid(*at):
        return node.setdefault(at, len(node) + 1)

    lines = ["BEGIN BULK", "MAT1,1,2.1+5,,0.3,7.85-9", "PSOLID,1,1", "PSHELL,2,1,3.0,1,,1"]
    for id, (i, j, k) in enumerate(blocks, start=1):
        own = [solid(i + a, j + b, k + c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines += [f"CHEXA,{id},1,{','.join(map(str, own[:6]))},", f",{own[6]},{own[7]}"]
    for id, (j, k) in enumerate(((j, k) for j in range(1, 6) for k in range(3, 13)), start=1001):
        own = [solid(3, j + b, k + c) for b, c in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines.append(f"CQUAD4,{id},2,{','.join(map(str, own))}")
    for j in range(1, 7) if tied else ():
        cross = [solid(3 + a, j + b, 3) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        lines.append(f"RBE3,{2000 + j},,{solid(3, j, 3)},456,1.0,123,{cross[0]},{cross[1]}")
        lines.append(f",{cross[2]},{cross[3]}")
    lines += [f"GRID,{id},,{6.0 * i},{6.0 * j},{6.0 * k}" for (i, j, k), id in node.items()]
    lines += [f"SPC1,1,123,{id}" for (_, _, k), id in node.items() if k == 0]
    lines += [f"FORCE,1,{solid(3, j, 13)},,{(0.1, 0.2)[1 < j < 6]},1.,0.,0." for j in range(1, 7)]
    file.write_text("\n".join([*lines, "ENDDATA", ""]))
    mesh = read_mesh(file, "mm", "t")
    return build_model(mesh), np.searchsorted(mesh.node_ids, [solid(3, j, 13) for j in range(1, 7)])


def test_shell_on_solid_face_follows_mean_rotation(tmp_path):
    """By shared nodes alone it is hinged. With neighbours two thicknesses away it is clamped: 4086 C3D20 of CalculiX 2.20 move
    by 4.890 µm where the block is rigid, and by 5.166 µm where it is not."""
    with pytest.raises(UserError, match=r"rotation about y through \(0.018, 0.021, 0.018\) m") as caught:
        strip_on_a_block(tmp_path / "hinged.bdf", tied=False)
    assert "share only nodes on one line are hinged" in caught.value.remedy
    model, top = strip_on_a_block(tmp_path / "strip.bdf", tied=True)
    S = input_shape(model, [PointLoad("push", deck_load="FORCE-1")])
    z = nodal(model, factorise(model.stiffness.constant).solve(S)).reshape(-1, 3)
    assert z[top, 0].mean() == pytest.approx(4.890e-6, rel=5e-3)


def test_script_reproduces_committed_decks(tmp_path):
    runpy.run_path(str(MESHES / "make_cantilever.py"))["main"](tmp_path)
    for name in ("cantilever.bdf", "cantilever-coarse.bdf", "SHA256SUMS"):
        assert (tmp_path / name).read_bytes() == (MESHES / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("part", ["lug", "hinge", "wing"])
def test_script_reproduces_committed_deck(tmp_path, part):
    """The packed bytes depend on the version of zlib, what is in them does not."""
    runpy.run_path(str(MESHES / f"make_{part}.py"))["main"](tmp_path)
    written, committed = (gzip.decompress((folder / f"{part}.bdf.gz").read_bytes()) for folder in (tmp_path, MESHES))
    assert written == committed
    for folder in (tmp_path, MESHES):
        digest, name = (folder / f"{part}.sha256").read_text().split()
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


@pytest.mark.slow
def test_wing_modes_match_readme():
    np.testing.assert_allclose(frequencies(read_mesh(MESHES / "wing.bdf.gz", "mm", "t"), 3), [8.16, 23.5, 38.4], rtol=2e-3)
