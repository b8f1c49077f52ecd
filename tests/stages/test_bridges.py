"""Bridges through the pipeline: bonded ones of a config or a file, and placement among patterns of them."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight import api
from strainsight.errors import ConfigError, UserError
from strainsight.experiment.layout.gauge_list import deck_frame
from strainsight.experiment.layout.workshop import Workshop, catman_table, elements_of, labview_table
from strainsight.experiment.structure.bonded_gauges import bonded_gauges, read_bonded
from strainsight.experiment.structure.placement import placement_output
from strainsight.runner.artefact import Artefact
from strainsight.sensors.edges import no_edges
from strainsight_cli.main import app

from ..edges.beam import NU, PLACEMENT_CONFIG, SIZE, E, bricks, config_of
from ..shared import once, without_hot_spots

L, B, H = SIZE
MIDDLE = {"top": [0.55, B / 2, H], "below": [0.55, B / 2, 0.0]}


def arm(where, direction, sign=1, **more):
    return {"position": MIDDLE[where], "direction": direction, "sign": sign, **more}


BENDING = {
    "name": "bending",
    "arms": [arm(where, [1, 0, 0], sign) for where, sign in (("top", 1), ("below", -1), ("top", 1), ("below", -1))],
}
TORSION = {
    "name": "torsion",
    "arms": [arm(where, [1, n * s, 0], s) for where, n in (("top", 1), ("below", -1)) for s in (1, -1)],
}


DECK = bricks((10, 5, 4), "hex20", tip=False)
"""The beam without the rigid element at its end."""


def written(folder: Path, changes, name="edge", deck=None) -> Path:
    """The config of a beam of 10 × 3 × 2 elements, as a file beside its deck."""
    (folder / "beam.bdf").write_text(deck or bricks((10, 3, 2), "hex20"), encoding="ascii")
    path = folder / f"{name}.yaml"
    config = config_of(PLACEMENT_CONFIG, {"name": name, "mesh.file": "beam.bdf", **changes})
    path.write_text(yaml.safe_dump(json.loads(json.dumps(config))))  # without anchors
    return path


def command(folder: Path, *words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, [*words, "--results", str(folder / "results")])
    return done.exit_code, " ".join(done.output.split())


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A layout of the two bridges and a gauge, with the file that says where they are."""

    def make(place: Path) -> None:
        path = written(place, {"gauges.fixed": [BENDING, TORSION], "place.keep": 3, "place.certificate": False})
        with without_hot_spots():
            code, said = command(place, "place", str(path))
        assert code == 0, said

    folder = tmp_path_factory.mktemp("bridges")
    shutil.copytree(once("bridges", repr((BENDING, TORSION)), make), folder, dirs_exist_ok=True)
    return folder


def lines(path: Path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_bridges_come_back_from_the_file_of_their_layout_as_they_were(project):
    bonded = project / "bonded.csv"
    bonded.write_bytes((project / "results" / "edge" / "gauges.csv").read_bytes())
    written(project, {"gauges.fixed_file": "bonded.csv", "place.keep": 3}, "again")
    code, said = command(project, "train", str(project / "again.yaml"))
    assert code == 0, said
    one, other = (api.open_run(project / "results" / name).training for name in ("edge", "again"))
    by_name = dict(zip(one.name, one.rows[one.candidates.first], strict=True))
    for name in ("bending", "torsion"):
        row = other.rows[other.candidates.first[other.name.index(name)]]
        np.testing.assert_allclose(row, by_name[name], rtol=0, atol=1e-9 * np.abs(by_name[name]).max())
    np.testing.assert_array_equal(np.sort(other.candidates.arms.sign), [-1] * 4 + [1] * 2)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"sign": ""}, "have no sign"),
        ({"sign": "2"}, "an arm of the bridge has the sign 2"),
        ({"gauge": "alone"}, "1 arm"),
    ],
)
def test_a_file_with_a_bridge_that_is_none_reports_it(project, tmp_path, change, what):
    rows = [row for row in lines(project / "results" / "edge" / "gauges.csv") if row["gauge"] == "torsion"]
    if change == {"sign": ""}:
        rows = [row | change for row in rows]
    else:
        rows[0] |= change
    with (tmp_path / "bonded.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    with pytest.raises(UserError, match=what):
        read_bonded(tmp_path / "bonded.csv")


def node_at(place) -> int:
    """The node of the deck without a rigid tip that is there."""
    grid = [line.split(",") for line in DECK.splitlines() if line.startswith("GRID")]
    apart = [np.linalg.norm(np.array([float(x) for x in card[3:6]]) - place) for card in grid]
    assert min(apart) < 1e-9
    return int(grid[int(np.argmin(apart))][1])


LOADS = {"middle": [L, B / 2, H / 2], "edge": [L, B, H / 2]}
"""Two forces along z on the free end: the second turns it, too."""
FREE = {
    "parameters.E.guess": E,
    "loads": {
        name: {
            "node": node_at(place),
            "direction": [0, 0, 1],
            "known": False,
            "signal": {"type": "sine", "frequency": 2.0, "amplitude": 500.0},
            "process_noise": {"model": "integrated_random_walk"},
        }
        for name, place in LOADS.items()
    },
    "gauges.noise_std": {"value": 1e-8},
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "tolerances": "none",
    "train": {"duration": 0.5, "time_step": 0.0025},
    "place.estimate": list(LOADS),
    "place.keep": 2,
    "validate.initial_std": dict.fromkeys(LOADS, 1.0),
}
GAUGE_FACTOR = 2.05


def torsion_function() -> tuple[float, float]:
    """Of Saint-Venant's torsion of B × H, B the longer: G θ' per torque, and τ in the middle of a longer side per torque, by the
    series of Timoshenko and Goodier, art. 109."""
    n = np.arange(1, 100, 2)
    reach = n * np.pi * B / (2 * H)
    twist = 3 / (H**3 * B * (1 - 192 / np.pi**5 * H / B * np.sum(np.tanh(reach) / n**5)))
    return twist, twist * H * (1 - 8 / np.pi**2 * np.sum(1 / (n**2 * np.cosh(reach))))


@pytest.mark.slow
def test_two_bridges_alone_recover_a_bending_and_a_twisting_load(tmp_path):
    """Readings by the closed forms, 4 ε of bending and 2 γ of torsion, as mV/V; the model has 0.9 % less shear at its facets.

    2 Hz is a thirtieth of the first frequency: the motion is static to 0.1 %."""
    changes = FREE | {
        "gauges.fixed": [BENDING, TORSION],
        "estimate": {
            "time": {"channel": "time"},
            "channels": [
                {
                    "channel": name,
                    "gauge": name,
                    "unit": "mV/V",
                    "bridge": {"arrangement": "sum", "gauge_factor": GAUGE_FACTOR},
                }
                for name in ("bending", "torsion")
            ],
            "start": "rest",
        },
    }
    path = written(tmp_path, changes, deck=DECK)
    t = 0.0025 * np.arange(401)
    force = {"middle": 400 * np.sin(4 * np.pi * t) ** 2, "edge": -300 * np.sin(6 * np.pi * t) ** 2}
    # A force along z > 0 presses the top; at the edge y = B it turns about +x, which is γ_xy < 0 on top: ε₊₄₅ − ε₋₄₅ < 0.
    bending = -4 * sum(force.values()) * (L - 0.55) * (H / 2) / (E * B * H**3 / 12)
    torsion = -2 * force["edge"] * (B / 2) * torsion_function()[1] * 2 * (1 + NU) / E
    r = 1e3 * GAUGE_FACTOR / 4 * np.column_stack([bending, torsion])
    head, rows = "time [s],bending [mV/V],torsion [mV/V]", np.column_stack([t, r])
    record = tmp_path / "test.csv"
    record.write_text("\n".join([head, *(",".join(f"{x:.12g}" for x in row) for row in rows), ""]))
    code, said = command(tmp_path, "estimate", str(path), "--measurements", str(record), "--no-page")
    assert code == 0, said
    found = Artefact(tmp_path / "results" / "edge" / "estimate.h5")
    for name, true in force.items():
        error = found[f"/smoothed/{name}"] - true
        assert np.sqrt(np.mean(error**2)) < 0.015 * np.sqrt(np.mean(true**2)), name

    for override, what in (("quarter", "reads the sum of its arms"), ("full", "strain of one arm")):
        setting = f"--set=estimate.channels.0.bridge.arrangement={override}"
        code, said = command(tmp_path, "estimate", str(path), "--measurements", str(record), "--no-page", setting)
        assert code == 2
        assert "estimate.channels[0].bridge.arrangement" in said or "estimate.channels.0.bridge.arrangement" in said
        assert what in said


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
EXACT = ("position", "angle", "common_gain", "transverse", "load_angle", "load_position", "load_gain", "load_mass", "discrepancy")
ONLY = {"damping": 1} | dict.fromkeys((*EXACT, "gain"), 0)


PATTERNS = bricks((8, 3, 2), "hex20")


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The mesh and its reduced model, and changes → a case and its training simulation."""
    folder = tmp_path_factory.mktemp("beam")
    plain = api.load(written(folder, UPRIGHT, deck=PATTERNS))
    mesh = api.mesh(plain)
    reduced = api.reduce(plain, mesh)

    def of(changes):
        case = api.load(written(folder, {**UPRIGHT, **changes}, deck=PATTERNS))
        return case, api.train(case, mesh, reduced)

    return mesh, reduced, of


def placed(beam, changes):
    mesh, reduced, of = beam
    case, training = of(changes)
    return api.place(case, mesh, reduced, training, api.screen(case, mesh, reduced, training))


@pytest.fixture(scope="module")
def by_pattern(beam):
    """Pattern → placement of one gauge or one bridge."""
    return {pattern: placed(beam, {"gauges.bridge": pattern}) for pattern in (None, "half-bending", "full-bending")}


@pytest.mark.slow
def test_a_bridge_knows_a_modulus_better_by_the_number_of_its_arms_and_no_arm_helps_where_they_cancel(beam, by_pattern):
    """Noise is that of the amplifier: σ falls as the arms, 2 and 4. By gains of 1 % under a slow load it falls as their root;
    by a gain that is common to all arms it stays."""
    sigma = [found.expected.std["E"] for found in by_pattern.values()]
    np.testing.assert_allclose(np.array(sigma[0]) / sigma, [1, 2, 4], rtol=0.01)
    where = [found.listed.position[0] for found in by_pattern.values()]
    np.testing.assert_allclose([x[0] for x in where], where[0][0])  # where bending is most
    listed = by_pattern["full-bending"].listed
    signs, arms = np.array(listed.signs, dtype=float), listed.grids
    np.testing.assert_array_equal(signs, [1, -1, 1, -1])
    np.testing.assert_allclose(arms.position[:, 2], np.where(signs * arms.normal[0, 2] > 0, SIZE[2], 0), atol=1e-9)

    # A load of 20 Hz tells E by the motion, too, whatever the gains are.
    slow = {"loads.tip.signal.frequency": 2.0, "train": {"duration": 0.5, "time_step": 0.005}}
    slow |= {"gauges.noise_std": {"value": 1e-7}}
    mesh, reduced, of = beam
    for error, std in (("gain", [0.01, 0.01 / np.sqrt(2), 0.005]), ("common_gain", [0.01] * 3)):
        gains = []
        for pattern, found in by_pattern.items():
            case, training = of({"gauges.bridge": pattern, "tolerances": ONLY | {error: 0.01}, **slow})
            screened = api.screen(case, mesh, reduced, training)
            gains.append(api.expect(case, mesh, reduced, training, screened, found.gauges).std["E"])
        np.testing.assert_allclose(gains, std, rtol=0.01)

    axial, bending = (beam[2]({"gauges.bridge": pattern})[1] for pattern in ("half-axial", "half-bending"))
    assert np.abs(axial.reading()).max() < 1e-9 * np.abs(bending.reading()).max()


@pytest.mark.parametrize("pattern", ["half-bending", "full-torsion"])
def test_a_bridge_that_was_placed_is_found_in_the_file_of_its_layout(beam, tmp_path, pattern):
    mesh, reduced, of = beam
    channels = [{"channel": "ch 1", "gauge": "G1", "unit": "m/m"}]
    case, training = of({"gauges.bridge": pattern, "estimate": {"channels": channels}})
    found = api.place(case, mesh, reduced, training, api.screen(case, mesh, reduced, training))
    lines = placement_output(found, mesh, case.config).files["gauges.csv"].decode().splitlines()
    (tmp_path / "bonded.csv").write_text("\n".join(lines))
    assert bonded_gauges(case.config, training, found.gauges, tmp_path / "bonded.csv") == {"G1": found.gauges[0]}

    sign = lines[0].split(",").index("sign")
    cells = [line.split(",") for line in lines]
    turned = [[*own[:sign], {"1": "-1", "-1": "1"}[own[sign]], *own[sign + 1 :]] for own in cells[1:]]
    (tmp_path / "other.csv").write_text("\n".join(map(",".join, [cells[0], *turned])))
    with pytest.raises(ConfigError, match=r"G1 (was bonded at|is rotated)"):
        bonded_gauges(case.config, training, found.gauges, tmp_path / "other.csv")


def test_no_opposite_side_is_an_error_with_key_and_remedy(beam):
    below, box = {"normal_cone": {"axis": [0, 1, 0], "angle": 20}}, {"box": [[-1, -1, -1], [2, 2, 0.01]]}
    with pytest.raises(UserError, match="a half-bending bridge: none of 18 candidate locations has an opposite facet") as caught:
        beam[2]({"gauges.bridge": "half-bending", "gauges.exclude": [*UPRIGHT["gauges.exclude"], below, box]})
    assert caught.value.key == "gauges.bridge"
    assert "both sides of the wall (gauges.surface" in caught.value.remedy


def test_a_range_limits_the_strain_of_every_arm_and_not_the_output_of_the_bridge(beam):
    """Two and four arms in bending read twice and four times the strain of one: the same places are beyond the range."""
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


def only_row(table):
    (row,) = csv.DictReader(StringIO(table.decode()), delimiter="\t")
    return row


@pytest.mark.parametrize(("pattern", "wired", "arms"), [("half-bending", "half, arms 1 and 2", 2), ("full-bending", "full", 4)])
def test_exports_have_the_wiring_the_slope_and_the_elements_of_a_bridge(by_pattern, pattern, wired, arms):
    """n arms of ±ε give r = n GF ε/4, and ε_B = n ε."""
    listed = by_pattern[pattern].listed
    row = only_row(catman_table(listed, SimpleNamespace(gauge_factor=2.0, resistance=120.0)))
    assert (row["Bridge"], row["Unit"]) == (wired, "um/m")
    row = only_row(labview_table(listed, SimpleNamespace(gauge_factor=2.0, resistance=None)))
    assert (row["Measurement type"], row["Strain configuration"]) == ("Bridge (V/V)", "")
    strain = 1e-4
    assert float(row["Scale slope"]) * arms * 2.0 * strain / 4 == pytest.approx(arms * strain)
    shop = Workshop(listed, no_edges(len(listed.grids)), deck_frame("mm"))
    assert elements_of(shop) == {listed.labels[0]: sorted(set(listed.grids.element.tolist()))}


def test_two_arms_of_one_sign_are_opposite(by_pattern):
    listed = by_pattern["half-bending"].listed
    arms = replace(listed.channels.arms, sign=np.ones(1, dtype=int))
    opposite = replace(listed, channels=replace(listed.channels, arms=arms))
    assert only_row(catman_table(opposite, SimpleNamespace(gauge_factor=2.0, resistance=120.0)))["Bridge"] == "half, arms 1 and 3"
