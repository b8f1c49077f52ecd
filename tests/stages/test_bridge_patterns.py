"""Placement among bridges: what they are worth beside single gauges, their tolerances, and what a run shows of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.cases.structure.bonded_gauges import bonded_gauges
from strainsight.cases.structure.placed import placement_output
from strainsight.errors import ConfigError, UserError

from ..edges.beam import PLACEMENT_CONFIG, SIZE, bricks, config_of

UPRIGHT = {
    "loads.tip.direction": [0, 0, 1],
    "gauges.exclude": [{"normal_cone": {"axis": axis, "angle": 20}} for axis in ([1, 0, 0], [0, 1, 0])],
    "gauges.direction.angles": [0.0],
    "gauges.clearance": "none",
    "gauges.noise_std": {"value": 1e-6},
    "screen.keep": "all",
    "place.keep": 1,
    "place.certificate": False,
    "place.installation": "ignore",
    "tolerances": "none",
    "process_noise": {"model_error": 1e-9},
}
"""Gauges on top and bottom of a beam that is bent about y, for E."""
ONLY_GAIN = {"gain": 0.01} | dict.fromkeys(
    ("position", "angle", "transverse", "load_angle", "load_position", "load_gain"), 0
)
ONLY_GAIN |= {"damping": 1, "discrepancy": 0}


def written(folder, changes):
    (folder / "beam.bdf").write_text(bricks((8, 3, 2), "hex20"), encoding="ascii")
    config = config_of(PLACEMENT_CONFIG, {**UPRIGHT, **changes})
    (folder / "edge.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(config))))
    return folder / "edge.yaml"


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The mesh and its reduced model, and changes → a case and its training run."""
    folder = tmp_path_factory.mktemp("beam")
    plain = api.load(written(folder, {}))
    mesh = api.mesh(plain)
    reduced = api.reduce(plain, mesh)

    def of(changes):
        case = api.load(written(folder, changes))
        return case, api.train(case, mesh, reduced)

    return mesh, reduced, of


def placed(beam, changes):
    mesh, reduced, of = beam
    case, training = of(changes)
    return api.place(case, mesh, reduced, training, api.screen(case, mesh, reduced, training))


def test_a_bridge_knows_a_modulus_better_by_the_number_of_its_arms_and_no_arm_helps_where_they_cancel(beam):
    """Noise is that of the amplifier: σ falls as the arms, 2 and 4. By gains of 1 % under a slow load it falls as their root."""
    noise = {pattern: placed(beam, {"gauges.bridge": pattern}) for pattern in (None, "half-bending", "full-bending")}
    sigma = [found.expected.std["E"] for found in noise.values()]
    np.testing.assert_allclose(np.array(sigma[0]) / sigma, [1, 2, 4], rtol=0.01)
    where = [found.listed.position[0] for found in noise.values()]
    np.testing.assert_allclose([x[0] for x in where], where[0][0])  # where bending is most
    arms = noise["full-bending"].listed.arms[0]
    np.testing.assert_array_equal(arms.sign, [1, -1, 1, -1])
    np.testing.assert_allclose(
        arms.grid.position[:, 2], np.where(arms.sign * arms.grid.normal[0, 2] > 0, SIZE[2], 0), atol=1e-9
    )

    # A load of 20 Hz tells E by the motion, too, whatever the gains are.
    slow = {"loads.tip.signal.frequency": 2.0, "train": {"duration": 0.5, "time_step": 0.005}}
    slow |= {"gauges.noise_std": {"value": 1e-7}, "tolerances": ONLY_GAIN}
    mesh, reduced, of = beam
    gains = []
    for pattern, found in noise.items():
        case, training = of({"gauges.bridge": pattern, **slow})
        screened = api.screen(case, mesh, reduced, training)
        gains.append(api.expect(case, mesh, reduced, training, screened, found.gauges).std["E"])
    np.testing.assert_allclose(gains, np.array([0.01, 0.01 / np.sqrt(2), 0.005]), rtol=0.01)

    axial, bending = (beam[2]({"gauges.bridge": pattern})[1] for pattern in ("half-axial", "half-bending"))
    assert np.abs(axial.reading()).max() < 1e-9 * np.abs(bending.reading()).max()


@pytest.mark.parametrize("pattern", ["half-bending", "full-torsion"])
def test_a_bridge_that_was_placed_is_found_in_the_file_of_its_layout(beam, tmp_path, pattern):
    mesh, reduced, of = beam
    channels = [{"channel": "ch 1", "gauge": "G1", "unit": "m/m"}]
    case, training = of({"gauges.bridge": pattern, "estimate": {"channels": channels}})
    found = api.place(case, mesh, reduced, training, api.screen(case, mesh, reduced, training))
    lines = placement_output(found, mesh, "mm").files["gauges.csv"].decode().splitlines()
    (tmp_path / "bonded.csv").write_text("\n".join(lines))
    assert bonded_gauges(case.config, training, found.gauges, tmp_path / "bonded.csv") == {"G1": found.gauges[0]}

    sign = lines[0].split(",").index("sign")
    cells = [line.split(",") for line in lines]
    turned = [[*own[:sign], {"1": "-1", "-1": "1"}[own[sign]], *own[sign + 1 :]] for own in cells[1:]]
    (tmp_path / "other.csv").write_text("\n".join(map(",".join, [cells[0], *turned])))
    with pytest.raises(ConfigError, match=r"G1 (sits elsewhere now|is turned)"):
        bonded_gauges(case.config, training, found.gauges, tmp_path / "other.csv")


def test_no_opposite_side_is_an_error_with_key_and_remedy(beam):
    below, box = {"normal_cone": {"axis": [0, 1, 0], "angle": 20}}, {"box": [[-1, -1, -1], [2, 2, 0.01]]}
    with pytest.raises(UserError, match="no place has one opposite for the arms of a half-bending bridge") as caught:
        beam[2]({"gauges.bridge": "half-bending", "gauges.exclude": [*UPRIGHT["gauges.exclude"], below, box]})
    assert caught.value.key == "gauges.bridge"
    assert "include both sides" in caught.value.remedy


def test_a_range_limits_the_strain_of_every_arm_and_not_the_output_of_the_bridge(beam):
    """Two and four arms of a beam in bending read twice and four times the strain of one, or nothing: the same places are beyond
    the range as of single gauges."""
    mesh, reduced, of = beam
    plain = of({})[1]
    limit = 0.7 * plain.peak.max()

    def beyond(pattern):
        case, training = of({"gauges.bridge": pattern, "gauges.range": float(limit)})
        found = api.screen(case, mesh, reduced, training)
        place = training.candidates.position[training.candidates.first]
        return training, {tuple(np.round(x[:2], 6)) for x in place[found.reason == "range"]}

    _, single = beyond(None)
    assert single
    for pattern, times in (("half-bending", 2.0), ("full-bending", 4.0)):
        training, found = beyond(pattern)
        assert found == single
        np.testing.assert_allclose(training.peak.max() / plain.peak.max(), times, rtol=1e-6)
        np.testing.assert_allclose(training.strained.max(), plain.peak.max(), rtol=1e-9)
    axial = of({"gauges.bridge": "half-axial"})[1]
    assert axial.peak.max() < 1e-6 * plain.peak.max()
    np.testing.assert_allclose(axial.strained.max(), plain.peak.max(), rtol=1e-9)
