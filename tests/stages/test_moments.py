"""An unknown moment in a placement, and a free structure through the whole pipeline."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError, UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Training
from strainsight.stages.pages.page import warnings_of
from strainsight.stages.view.strain import caption, strains_of
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, SIZE, TIP, E, bricks, config_of, finished
from ..shared import strains

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


DECK = re.sub(r"^SPC[^\n]*\n(,[^\n]*\n)*", "", bricks((8, 1, 1), "hex20"), flags=re.MULTILINE)
FREE = {
    "mesh.free": True,
    "rom.modes": 6,
    "loads.tip.known": False,
    "loads.tip.process_noise": {"frequency": 30.0},
    "loads.push": {
        "node": TIP,
        "direction": [1.0, 0.0, 0.0],
        "known": True,
        "signal": {"type": "sine", "frequency": 25.0, "amplitude": 2000.0},
    },
    "train": {"duration": 0.2, "time_step": 0.001, "settle": "auto"},
    "place.estimate": ["E", "tip"],
    "place.keep": 3,
    "validate.duration": 0.2,
    "validate.initial_std": {"E": 0.1, "tip": 1.0},
    "gauges.exclude": [
        {"normal_cone": {"axis": [1, 0, 0], "angle": 10}},
        {"box": [[-0.1, -0.1, -0.1], [0.13, 0.2, 0.2]]},  # no gauge there beside springs
    ],
    "gauges.noise_std": {"value": 2e-7},
    "gauges.fixed": [
        {"position": [x, 0.05, z], "direction": [1, 0, 0]} for x, z in ((0.81, 0), (0.81, 0.08), (0.69, 0.08))
    ],
    "process_noise": {"model_error": 0.0},
    "tolerances": "none",
}
SOFT = {
    "mesh.free": False,
    "mesh.faces": {"end": {"near": [0.0, 0.05, 0.04]}},
    "mesh.supports": [{"set": "end", "stiffness": 50.0}],
    "rom.modes": 12,
    "validate.truth.modes": 12,
}


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("free"), "validate", DECK, FREE)


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("soft"), "validate", DECK, {**FREE, **SOFT})


@pytest.fixture(scope="module")
def firm(tmp_path_factory):
    """On springs of 0.28 Hz. E of it is 4.7e-4 away; beside loads that are free softer ones lose more digits, 6e-4 to 1e-3 and
    scattered at half of the stiffness and less, 4.5e-3 at a tenth, and firmer ones carry the loads, 3e-3 of tip at five times."""
    springs = {"mesh.supports": [{"set": "end", "stiffness": 200.0}]}
    return finished(tmp_path_factory.mktemp("firm"), "place", DECK, {**FREE, **SOFT, **springs})


def test_readings_are_those_on_springs_that_nothing_notices(free, soft):
    """Springs of 0.14 Hz under loads of 20 and 25 Hz carry (0.14/20)² = 5e-5 of them; softer ones lose more digits than that."""
    frequency, held = read(Modes, free["modes"]).frequency, read(Modes, soft["modes"]).frequency
    assert np.all(held[:6] < 0.5)
    assert np.allclose(frequency, held[6:], rtol=1e-5)
    one, other = strains(free["train"]), strains(soft["train"])
    assert np.abs(one - other).max() < 2e-4 * np.abs(other).max()


def test_modulus_and_unknown_load_are_found_as_on_soft_springs(free, soft, firm):
    place, other = free["place"].summary, firm["place"].summary
    found, held = free["validate"].summary, soft["validate"].summary
    for name in ("E", "tip"):
        assert place[f"std.{name}"] == pytest.approx(other[f"std.{name}"], rel=1e-3)
        assert found[f"std.{name}"] == pytest.approx(
            held[f"std.{name}"], rel=0.03
        )  # each lattice of the bank is right to 0.01
    assert found["estimate.E"] == pytest.approx(held["estimate.E"], abs=0.1 * found["std.E"] * E)
    assert found["error.E"] < 0.02
    assert found["error.E"] < 3 * found["std.E"]
    assert "null_direction" not in place


def test_no_page_complains_that_nothing_is_fixed(free):
    """Nothing is, on purpose; of what was not reduced yet it is said."""
    mesh, loads = mesh_from(free["import"]), {}
    assert not any("nothing is fixed" in text for text in warnings_of(free, ["E"], mesh, loads))
    assert any("nothing is fixed" in text for text in warnings_of({"import": free["import"]}, ["E"], mesh, loads))


def test_the_pushed_bar_strains_as_inertia_relief_has_it(free):
    """Static response to a unit push at x = L: mean axial displacement x²/(2EAL) beside a constant."""
    reduced = read(Reduced, free["rom"])
    q = np.linalg.solve(
        reduced.model.stiffness.at(reduced.model.reference),
        reduced.model.input_shape[:, reduced.model.inputs.index("push")],
    )
    z = (reduced.basis @ q).reshape(-1, 3)
    x = free["import"]["/nodes/position"][:, 0]
    ends = [z[np.isclose(x, at), 0].mean() for at in (0.0, 0.5, 1.0)]
    modulus, area = reduced.model.reference["E"], SIZE[1] * SIZE[2]
    assert ends[1] - ends[0] == pytest.approx(0.125 / (modulus * area), rel=2e-2)


def test_a_load_alone_is_shown_against_inertia(free, tmp_path):
    """The push of 1 MN at x = L: axial strain F x/(EAL), so half of F/(EA) on the facets in the middle, whatever Poisson adds."""
    model = config(tmp_path, {}).model
    push = next(own for own in strains_of(model, mesh_from(free["import"]), free) if own.load == "push")
    assert caption(push).replace("\u00a0", " ") == "push alone, 1 MN against inertia"
    facets = exterior_facets(mesh_from(free["import"]))
    corners = free["import"]["/nodes/position"][facets.nodes[:, :4]].mean(axis=1)
    side = np.isclose(corners[:, 1], SIZE[1]) & (np.abs(corners[:, 0] - 0.5) < 0.1)
    expected = 1e6 * corners[side, 0] / (model.parameters["E"].guess * SIZE[1] * SIZE[2])
    assert side.sum() >= 2
    assert np.allclose(push.strain[side], expected, rtol=0.05)


def config(tmp_path, changes):
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, FREE), changes)))
    return load_config(path)


@pytest.mark.parametrize("quantity", ["acceleration", "displacement"])
def test_sensors_of_motion_are_refused_with_the_reason(tmp_path, quantity):
    sensor = {"quantity": quantity, "noise_std": {"value": 1e-3}}
    with pytest.raises(ConfigError, match="reads the rigid motion, which is left out of a free structure") as caught:
        config(tmp_path, {"motion_sensors": {"mid": sensor}})
    assert caught.value.key == "motion_sensors.mid"
    assert "soft springs" in str(caught.value)


def test_ready_matrices_and_bodies_of_a_bench_are_not_free(tmp_path):
    term = {"file": "k.mtx"}
    matrices = {"numbering": "n.csv", "stiffness": [{**term, "parameter": "E"}], "mass": [term]}
    with pytest.raises(ConfigError, match="is of an assembled model"):
        config(tmp_path, {"mesh.matrices": matrices, "parameters.E.region": None})
    with pytest.raises(ConfigError, match="a body of a bench is free in any case"):
        finished(tmp_path, "import", DECK, {"bodies.beam.mesh.free": True}, BENCH_CONFIG)


def test_a_weight_strains_nothing_and_a_density_of_a_part_is_refused(tmp_path):
    weight = {"gravity": [0, 0, -9.81], "known": True, "signal": {"type": "sine", "frequency": 20.0, "amplitude": 1.0}}
    with pytest.raises(UserError, match=r"accelerates a free structure .* as a whole and strains nothing") as caught:
        finished(tmp_path / "weight", "rom", DECK, {**FREE, "loads.weight": weight})
    assert caught.value.key == "loads.weight"
    carried = DECK.replace("ENDDATA", f"CONM2,77,{TIP},,5.0\nENDDATA")
    rho = {"property": "density", "region": 1, "guess": 7850.0, "range": [7000.0, 8500.0]}
    with pytest.raises(UserError, match="the density of a part of a free structure is unknown") as caught:
        finished(tmp_path / "density", "modes", carried, {**FREE, "parameters.rho": rho})
    assert caught.value.key == "parameters.rho"


def test_the_truth_in_time_of_the_whole_model_agrees(free, tmp_path):
    """All degrees of freedom integrated, which shares no mode with the truth by modes."""
    shutil.copytree(free["rom"].path.parents[2], tmp_path, dirs_exist_ok=True)  # what does not depend on the truth
    whole = finished(
        tmp_path, "validate", DECK, {**FREE, "validate.truth": {"model": "full", "parameters": {"E": E}, "modes": 6}}
    )
    one, other = free["validate"]["/gauge/true"], whole["validate"]["/gauge/true"]
    assert np.abs(one - other).max() < 2e-4 * np.abs(other).max()
