"""Bridges through the pipeline: from a config, or the file of a layout, to rows, tolerances, pages and estimates."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from strainsight import api
from strainsight_cli.main import app

from ..edges.beam import PLACEMENT_CONFIG, SIZE, bricks, config_of

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


def written(folder: Path, changes, name="edge") -> Path:
    """The config of a beam of 10 × 5 × 4 elements, as a file beside its deck."""
    (folder / "beam.bdf").write_text(bricks((10, 5, 4), "hex20"), encoding="ascii")
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
    folder = tmp_path_factory.mktemp("bridges")
    path = written(folder, {"gauges.fixed": [BENDING, TORSION], "place.keep": 3})
    code, said = command(folder, "place", str(path))
    assert code == 0, said
    return folder


def lines(path: Path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_layout_lists_every_arm_with_its_sign(project):
    rows = lines(project / "results" / "edge" / "gauges.csv")
    own = [row for row in rows if row["gauge"] == "torsion"]
    assert [row["sign"] for row in own] == ["1", "1", "-1", "-1"]
    assert {row["kind"] for row in own} == {"bridge"}
    assert [float(row["normal_z"]) for row in own] == [1, -1, 1, -1]
    assert len([row for row in rows if row["gauge"] == "bending"]) == 4
    assert [row["sign"] for row in rows if row["gauge"] not in ("bending", "torsion")] == [""]
    assert (project / "results" / "edge" / "gauges.unv").read_text().count("torsion arm ") == 4


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
        ({"sign": "2"}, "an arm of sign 2"),
        ({"position_z": "0.2"}, "torsion is 0.12 m from the surface"),
        ({"gauge": "alone"}, "1 arm"),
    ],
)
def test_a_file_with_a_bridge_that_is_none_says_so(project, tmp_path, change, what):
    rows = [row for row in lines(project / "results" / "edge" / "gauges.csv") if row["gauge"] == "torsion"]
    if change == {"sign": ""}:
        rows = [row | change for row in rows]
    else:
        rows[0] |= change
    with (tmp_path / "bonded.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    path = written(tmp_path, {"gauges.fixed_file": "bonded.csv", "place.keep": 3})
    code, said = command(tmp_path, "train", str(path))
    assert code == 2
    assert what in said
