"""An orthotropic material of the config: as an isotropic one where its constants are, along its axes, and errors."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.cases.structure.mesh import with_additions
from strainsight.config.load import load_config
from strainsight.config.mesh import MeshFile
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError, UserError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.workflow.runner import run

from ..anisotropy import CONSTANTS, TURN, flexibility, strains, turned, work
from ..shared import ROOT, SHORT, job_of, made, stages_of

CONFIG = (ROOT / "configs" / "cantilever-youngs-modulus.yaml").read_text(encoding="utf-8")
COARSE = ROOT / "meshes" / "cantilever-coarse.bdf"
STEEL = "youngs_modulus: 2.1e+11, poisson_ratio: 0.3"
ALIKE = (
    "youngs_modulus: [2.1e+11, 2.1e+11, 2.1e+11], poisson_ratio: [0.3, 0.3, 0.3], "
    f"shear_modulus: [{', '.join([str(2.1e11 / 2.6)] * 3)}], "
    "axes: {x: [1, 2, 0], y: [0, 1, 3], origin: [0, -5, 2], system: cylindrical}"
)
FACTOR = "property: stiffness_factor, region: 1, guess: 0.9, range: [0.8, 1.2]"


def config_of(folder, constants, parameter=FACTOR):
    materials = f"{{own: {{regions: all, {constants}, density: 7850.0}}}}"
    text = CONFIG.replace("file: ../meshes/cantilever.bdf,", f"file: {COARSE}, materials: {materials},")
    text = text.replace("property: youngs_modulus, region: 1, guess: 1.89e+11, range: [1.6e+11, 2.4e+11]", parameter)
    path = folder / "own.yaml"
    path.write_text(text.replace("{E: 2.1e+11}", "{E: 1.0}"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """stage → artefact of one run with the isotropic material, and of one with the same constants as an orthotropic one."""
    found = []
    for constants in (STEEL, ALIKE):
        folder = tmp_path_factory.mktemp("run")
        settings = *SHORT, "screen.keep=12", "rom.parameter_samples=2"
        found.append(made(config_of(folder, constants), *settings, until="place"))
    return found


def test_the_same_constants_give_the_same_frequencies_layout_and_estimate(both):
    plain, own = both
    np.testing.assert_allclose(own["modes"]["/frequency"], plain["modes"]["/frequency"], rtol=1e-9)
    for name, value in plain["place"].summary.items():
        if isinstance(value, float):
            assert own["place"].summary[name] == pytest.approx(value, rel=1e-5), name
    assert "/anisotropic/stiffness" in own["import"].paths()
    assert own["import"]["/orientations/origin"][0] == pytest.approx([0, -5, 2])
    assert not [path for path in plain["import"].paths() if path.startswith(("/anisotropic", "/orientations"))]


def test_axes_of_a_config_are_those_of_the_tensor(tmp_path):
    """Work of every strain by S of its stress, per volume, at a rotated rectangular system."""
    (e, nu, g), (x, y) = CONSTANTS, (TURN[:, 0], TURN[:, 1] + 0.4 * TURN[:, 0])
    axes = f"axes: {{x: {x.tolist()}, y: {y.tolist()}}}"
    constants = f"youngs_modulus: {list(e)}, poisson_ratio: {list(nu)}, shear_modulus: {list(g)}, {axes}"
    loaded = load_config(config_of(tmp_path, constants)).model.mesh
    mesh = with_additions(read_mesh(COARSE), loaded)
    assert isinstance(loaded, MeshFile)
    K, S = assemble_stiffness(mesh), turned(flexibility(*CONSTANTS), TURN)
    for stress in 1e9 * np.array(strains()):
        z = (mesh.position @ np.einsum("ijkl,kl->ij", S, stress)).ravel()
        assert 0.5 * z @ (K @ z) == pytest.approx(2 * 0.25 * 0.19 * work(S, stress), rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("[0.3, 0.3, 0.3]", "0.3", "not poisson_ratio"),
        (", shear_modulus", ", axes: {}, shear_modulus", "axes"),
        ("[2.1e+11, 2.1e+11, 2.1e+11]", "2.1e+11", "not youngs_modulus"),
        ("x: [1, 2, 0]", "x: [0, 2, 6]", "runs along x"),
        ("[2.1e+11, 2.1e+11, 2.1e+11], poisson_ratio: [0.3, 0.3, 0.3], shear", "2.1e+11, poisson_ratio: 0.3, x", "x_modulus"),
    ],
)
def test_a_contradiction_is_named(tmp_path, old, new, what):
    assert old in ALIKE
    with pytest.raises(StrainsightError, match=what):
        load_config(config_of(tmp_path, ALIKE.replace(old, new)))


def test_a_material_that_is_none_and_a_modulus_that_is_one_of_several_are_refused(tmp_path):
    mesh = read_mesh(COARSE)
    bad = load_config(config_of(tmp_path, ALIKE.replace("[0.3, 0.3, 0.3]", "[0.3, 0.3, 1.2]"))).model.mesh
    with pytest.raises(UserError, match="least eigenvalue is -") as caught:
        with_additions(mesh, bad)
    assert caught.value.key == "mesh.materials.own"
    modulus = "property: youngs_modulus, region: 1, guess: 2.0e+11, range: [1.6e+11, 2.4e+11]"
    job = job_of(config_of(tmp_path, ALIKE, modulus), tmp_path, *SHORT, "validate.truth.parameters.E=2.1e+11")
    with pytest.raises(UserError, match="of an anisotropic material: it has no single Young's modulus") as caught:
        for _ in run(stages_of(job, "rom"), job):
            pass
    assert "stiffness_factor" in caught.value.remedy
