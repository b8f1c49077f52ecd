"""A free structure through the whole pipeline, against one on springs so soft that nothing notices them."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
import yaml

from strainsight.config.load import load_config
from strainsight.errors import ConfigError, UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Modes, Reduced
from strainsight.stages.pages.page import warnings_of
from strainsight.stages.view.strain import caption, strains_of

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, SIZE, TIP, E, bricks, config_of, finished
from ..shared import strains

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
