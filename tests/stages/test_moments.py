"""An unknown moment in a placement: the strain of beam theory, its σ and its estimate in N m, and a known one in a test."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.records.record import read
from strainsight.records.training import Training
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..edges.beam import PLACEMENT_CONFIG, SIZE, TIP, E, bricks, config_of, finished

MOMENT, FORCE = 500.0, 200.0
SLOW = {"type": "sine", "frequency": 1.0}
LOADS = {
    "bend": {
        "node": TIP,
        "moment": [0, 3, 0],
        "known": False,
        "signal": SLOW | {"amplitude": MOMENT},
        "process_noise": {"model": "integrated_random_walk"},
    },
    "push": {
        "node": TIP,
        "direction": [0, 1, 0],
        "known": False,
        "signal": SLOW | {"amplitude": FORCE, "frequency": 2.0},
        "process_noise": {"model": "integrated_random_walk"},
    },
}
CHANGES = {
    "loads": LOADS,
    "parameters": {},
    "train": {"duration": 1.0, "time_step": 0.01},
    "gauges.direction.angles": [0.0],
    "gauges.clearance": "none",
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "gauges.noise_std": {"value": 1e-7},
    "tolerances": "none",
    "screen": {"keep": "all"},
    "place": {"estimate": ["bend", "push"], "keep": 3},
    "validate.truth": {"model": "rom", "parameters": {}},
    "validate.time_step": 0.01,
    "validate.duration": 1.0,
    "validate.initial_std": {"bend": 1.0, "push": 1.0},
}
MESH = bricks((10, 2, 2), "hex20")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("moment"), "report", MESH, CHANGES)


def test_a_tip_moment_strains_a_cantilever_by_mc_over_ei(run):
    """ε = M z/(EI) of a moment about y; at 1 Hz of 65 the inertia adds 2e-4, half way from clamp and end these do nothing."""
    training = read(Training, run["train"])
    x, _, z = (training.candidates.position - [0, SIZE[1] / 2, SIZE[2] / 2]).T
    inertia = SIZE[1] * SIZE[2] ** 3 / 12
    at = training.load[:, np.argmax(training.load.max(axis=0))]
    middle = (np.abs(x - 0.5) < 0.2) & (np.abs(z) > 0.49 * SIZE[2])
    assert middle.sum() >= 4
    # the force along y strains in proportion to y, its part at 2 Hz is orthogonal to the moment's at 1 Hz
    found = training.reading(np.flatnonzero(middle))[:-1].T @ at[:-1] / (at[:-1] @ at[:-1])
    np.testing.assert_allclose(found, z[middle] / (E * inertia), rtol=1e-3)
    assert set(np.sign(z[middle])) == {-1.0, 1.0}


def test_a_moment_is_in_newton_metres_wherever_it_is_named(run):
    own = run
    assert own["train"].attributes("/input")["units"] == "N or N m"
    for key in ("truth", "estimate", "std", "smoothed"):
        assert own["validate"].attributes(f"/{key}/bend")["units"] == "N m"
        assert own["validate"].attributes(f"/{key}/push")["units"] == "N"
    table = next(table for table in own["validate"].tables if table.title.startswith("estimates"))
    said = {row[0]: " ".join(row) for row in table.rows}
    assert "N m RMS" in said["bend"]
    assert "N RMS" in said["push"]
    page = (own["report"].path.parent / "report.html").read_text(encoding="utf-8")
    assert "N m" in page


def test_the_moment_is_found_again_and_sigma_is_what_placement_expected(run):
    own, summary = run, run["validate"].summary
    assert summary["estimate.bend"] == pytest.approx(MOMENT / np.sqrt(2), rel=0.01)
    assert summary["error.bend"] < 0.01
    assert summary["smoothed.bend"] < 0.005
    claimed = summary["std.bend"] * summary["scale.bend"]
    assert own["place"]["/expected_std/bend"][()] == pytest.approx(claimed, rel=0.1)
    assert own["place"].attributes("/expected_std/bend")["scale"] == MOMENT


def test_process_noise_of_a_moment_scales_with_its_amplitude(tmp_path):
    """In units of the amplitude σ hangs on σ of the gauges over their readings alone: twice both, σ is twice as large in N m."""
    found = {}
    for factor in (1.0, 2.0):
        scaled = {
            name: load | {"signal": load["signal"] | {"amplitude": factor * load["signal"]["amplitude"]}}
            for name, load in LOADS.items()
        }
        changes = CHANGES | {"loads": scaled, "gauges.noise_std": {"value": factor * 1e-7}}
        place = finished(tmp_path / f"{factor:g}", "place", bricks((4, 2, 2)), changes)["place"]
        found[factor] = float(place["/expected_std/bend"][()])
    assert found[2.0] == pytest.approx(2 * found[1.0], rel=1e-6)


def test_a_known_moment_is_read_in_newton_metres_and_nothing_else(tmp_path):
    known = CHANGES | {
        "loads": LOADS | {"bend": LOADS["bend"] | {"known": True}},
        "place": {"estimate": ["push"], "keep": 3},
    }
    known["validate.initial_std"] = {"push": 1.0}
    own = finished(tmp_path, "validate", bricks((4, 2, 2)), known)
    record = own["validate"].path.parent / "measured.csv"
    head = record.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert head[-1] == "bend [N m]"
    labels = [name for name in head if name.startswith("G")]
    assert len(labels) == 3
    for unit in ("N m", "N"):
        estimate = {
            "file": str(record),
            "as_placed": True,
            "time": {"channel": "time"},
            "channels": [
                {"channel": name.split(" ")[0], "gauge": name.split(" ")[0], "unit": "m/m"} for name in labels
            ],
            "inputs": {"bend": {"channel": "bend", "unit": unit, "override": True}},
        }
        path = tmp_path / "edge.yaml"
        path.write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, known | {"estimate": estimate})), encoding="utf-8")
        result = CliRunner().invoke(app, ["estimate", str(path), "--results", str(tmp_path / "results")])
        if unit == "N":
            assert result.exit_code == 2
            assert "force, but it is to be a moment" in " ".join(result.output.split())
        else:
            assert result.exit_code == 0, result.output
            found = Artefact(tmp_path / "results" / "edge" / "estimate.h5")
            assert found.attributes("/known/bend")["units"] == "N m"
            assert found.attributes("/std/push")["units"] == "N"
            assert np.abs(found["/known/bend"]).max() == pytest.approx(MOMENT, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "key", "remedy"),
    [
        ({"direction": [0, 0, 1]}, "loads.bend.direction", "remove one of the two keys"),
        ({"moment": [0, 0, 0]}, "loads.bend.moment", "give a vector"),
        ({"deck_load": "FORCE-1", "node": None}, "loads.bend.moment", "remove the key"),
    ],
)
def test_a_moment_that_is_stated_wrongly_is_refused(tmp_path, change, key, remedy):
    path = tmp_path / "edge.yaml"
    loads = LOADS | {"bend": LOADS["bend"] | change}
    path.write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, CHANGES | {"loads": loads})), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    found = [error for error in (caught.value, *caught.value.others) if error.key == key]
    assert found
    assert remedy in found[0].remedy
