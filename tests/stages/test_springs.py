"""A free beam on soft springs that the config states: its modes, its layout, and what a support on springs may say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from strainsight.cases.structure.mesh import checked, mesh_of
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, DeckError, UserError
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Modes

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, RHO, SIZE, TIP, bricks, config_of, finished

MESH = re.sub(r"^SPC[^\n]*\n(,[^\n]*\n)*", "", bricks((8, 1, 1), "hex20"), flags=re.MULTILINE)
K = 2.0e4
ENDS = {"left": {"near": [0, 0.05, 0.04]}, "right": {"near": [1, 0.05, 0.04]}}
CHANGES = {
    "mesh.faces": ENDS,
    "mesh.supports": [{"set": "left", "stiffness": K}, {"node": TIP, "stiffness": [K, 2 * K, K]}],
    "rom.modes": 8,
    "train": {"duration": 0.2, "time_step": 0.001, "settle": "auto"},
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "tolerances": "none",
}


def test_the_lowest_modes_are_those_of_a_rigid_bar_on_its_springs_and_gauges_find_a_modulus(tmp_path):
    """√(2k/m) along x is one of the six; the elastic ones lie far above them."""
    run = finished(tmp_path, "place", MESH, CHANGES)
    found = read(Modes, run["modes"]).frequency
    m = RHO * np.prod(SIZE)
    along = np.sqrt(2 * K / m) / (2 * np.pi)
    assert np.min(np.abs(found[:6] / along - 1)) < 1e-4
    assert found[6] / found[5] > 10
    mesh = mesh_from(run["import"])
    assert [own.name for own in mesh.springs] == ["mesh.supports.0", "mesh.supports.1"]
    assert mesh.springs[0].stiffness.sum() == pytest.approx(3 * K)
    assert mesh.springs[1].stiffness.tolist() == [K, 2 * K, K]
    assert len(mesh.fixed) == 0
    assert 0 < run["place"].summary["std.E"] < 0.1


def config(tmp_path: Path, changes) -> PlacementConfig:
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, CHANGES), changes)))
    model = load_config(path).model
    assert isinstance(model, PlacementConfig)
    return model


@pytest.mark.parametrize(
    ("support", "key"),
    [
        ({"set": "left", "stiffness": 0.0}, "stiffness"),
        ({"set": "left", "stiffness": [1.0, -1.0, 0.0]}, "stiffness"),
        ({"node": TIP, "stiffness": [1.0, 1.0, 1.0], "components": [4]}, "components"),
        ({"node": TIP, "stiffness": 1.0, "components": [1, 4]}, "components"),
        ({"set": "left", "stiffness": 1.0, "components": [4]}, "components"),
    ],
)
def test_supports_that_contradict_themselves_are_named(tmp_path, support, key):
    with pytest.raises(ConfigError) as caught:
        config(tmp_path, {"mesh.supports": [support]})
    assert caught.value.key == f"mesh.supports[0].{key}"


def test_nodes_of_a_set_share_and_rotations_are_those_of_a_node_that_has_some(tmp_path):
    (tmp_path / "beam.bdf").write_text(MESH.replace("ENDDATA", "SET1,9,1,2,3,4\nENDDATA"))

    def mesh(*supports):
        own = config(tmp_path, {"mesh.supports": list(supports)}).mesh
        found = mesh_of(own, tmp_path / "beam.bdf")
        checked(found, own)
        return found

    shared = mesh({"set": "SET1-9", "stiffness": 8.0, "components": [2]}).springs[0]
    assert shared.stiffness.tolist() == [2.0] * 4
    assert set(shared.component.tolist()) == {1}
    turned = mesh({"node": TIP, "stiffness": 8.0, "components": [5]}).springs[0]
    assert turned.torsion.tolist() == [True]
    with pytest.raises(DeckError, match=r"mesh.supports.0 acts on rotations of node 3, which has none"):
        mesh({"node": 3, "stiffness": 8.0, "components": [5]})


def test_a_body_of_a_bench_has_no_springs(tmp_path):
    with pytest.raises(ConfigError, match=r"mesh.supports.0: springs of a body are not supported") as caught:
        finished(tmp_path, "import", MESH, {"bodies.beam.mesh.supports": [{"node": TIP, "stiffness": K}]}, BENCH_CONFIG)
    assert caught.value.key == "bodies.beam.mesh"


FOUNDATION = {
    "mesh.faces": {"root": ENDS["left"]},
    "mesh.supports": [{"set": "root", "stiffness": 5.0e9}],
    "parameters": {
        "s": {"property": "stiffness_factor", "springs": ["mesh.supports.0"], "guess": 1.0, "range": [0.7, 1.5]}
    },
    "loads.tip.signal.frequency": 35.0,
    "rom": {"modes": 6, "parameter_samples": 4},
    "gauges.exclude": CHANGES["gauges.exclude"],
    "place.estimate": ["s"],
    "tolerances": "none",
    "validate.truth": {"model": "modes", "parameters": {"s": 1.2}, "modes": 8},
    "validate.initial_std": {"s": 0.1},
}


def test_a_test_finds_the_stiffness_of_a_foundation(tmp_path):
    """A cantilever whose root turns on springs: the truth has 1.2 of their stiffness, the guess is 1."""
    run = finished(tmp_path, "validate", MESH, FOUNDATION)
    found = run["validate"].summary
    assert 0 < found["std.s"] < 0.05
    assert abs(found["estimate.s"] - 1.2) < 2 * found["std.s"]


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"parameters.s.springs": ["mesh.support.0"]}, "parameters.s.springs", "no spring 'mesh.support.0'"),
        ({"parameters.s.region": 1}, "parameters.s.springs", "region is given too"),
        ({"parameters.s.springs": None}, "parameters.s.region", "missing"),
        ({"parameters.s.property": "density"}, "parameters.s.property", "springs have no density"),
        ({"parameters.s.guess": 30.0, "parameters.s.range": [0.7, 40.0]}, "parameters.s.guess", "has 1 in mesh.supports.0"),
        ({"parameters.t": FOUNDATION["parameters"]["s"]}, "parameters", "s and t are both the stiffness of the spring"),
    ],
)  # fmt: skip
def test_springs_of_a_parameter_are_looked_for_at_import(tmp_path, changes, key, what):
    with pytest.raises(UserError, match=what) as caught:
        finished(tmp_path, "import", MESH, FOUNDATION | changes)
    assert caught.value.key == key
    assert caught.value.remedy
