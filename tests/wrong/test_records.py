"""Records and load histories with a mistake, in the example `test`: refused, or warned of, before anything runs."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from strainsight.cases.structure.early import check_files
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight_cli.example import write

from ..stages.test_first_day import HISTORY, history


def said(folder: Path, *changes: tuple[str, str]) -> str:
    """What the files of the example contradict: the error, or else the warnings."""
    config = folder / "test.yaml"
    text = config.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    config.write_text(text, encoding="utf-8")
    loaded = load_config(config).model
    assert isinstance(loaded, PlacementConfig)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_files(loaded, folder)
        except UserError as error:
            return str(error)
    return " ".join(str(own.message) for own in caught)


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write("test", Path(), False)
    return tmp_path


def rows(folder: Path) -> tuple[str, np.ndarray]:
    head, *lines = (folder / "test.csv").read_text(encoding="utf-8").splitlines()
    return head, np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])


def rewrite(folder: Path, head: str, values: np.ndarray) -> None:
    lines = [head, *(",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in values)]
    (folder / "test.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_the_example_is_sound(project):
    assert said(project) == ""


@pytest.mark.parametrize("mark", [-9999.0, 99999.0])
def test_a_number_that_stands_for_a_missing_value_is_named_with_its_line_and_the_key(project, mark):
    head, values = rows(project)
    values[7:9, 1] = mark
    rewrite(project, head, values)
    found = said(project)
    assert "test.csv:9  estimate.channels.0" in found
    assert f"'G1' reads {mark:g} um/m in 2 of" in found
    assert "it stands for a missing value" in found
    named = said(project, ("file: test.csv", f'file: test.csv\n  text: {{missing: ["{mark:.9g}"]}}'))
    assert named == ""


@pytest.mark.parametrize("level", [1e5, 9999.0])
def test_a_load_in_a_step_is_a_load(project, level):
    lines = HISTORY["f.csv"].splitlines()
    plateau = [line.partition(",")[0] + f",{level:g}" for line in lines[100:150]]
    (project / "f.csv").write_text("\n".join([*lines[:100], *plateau, *lines[150:]]) + "\n", encoding="utf-8")
    assert "missing value" not in said(project, history())


def test_a_noise_above_every_reading_is_warned_of(project):
    found = said(project, ("channel: G1,", "channel: G1, noise_std: 0.1,"))
    assert "the noise of G1, 0.1, exceeds its largest reading" in found
    assert "G2" not in found


def mark_among_large(values):
    values[:, 1] *= 3000.0 / np.nanmax(np.abs(values[:, 1]))
    values[[20, 40, 41], 1] = -32768.0


def mark_between_smooth(values):
    values[:, 1] = 2500.0 * np.sin(np.linspace(0.0, 20.0, len(values)))
    values[[20, 40, 41], 1] = -999.0


def marks_of_both_signs(values):
    values[20, 1], values[40, 1] = 9999.0, -9999.0


def dead_and_clipped(values):
    limit = 0.5 * np.nanmax(np.abs(values[:, 2]))
    values[:, 1], values[:, 2] = 12.0, np.clip(values[:, 2], -limit, limit)


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (mark_among_large, ["'G1' reads -32768 um/m in 3 of"]),
        (mark_between_smooth, ["'G1' reads -999 um/m in 3 of"]),
        (marks_of_both_signs, ["it stands for a missing value"]),
        (dead_and_clipped, ["G1 reads one value in all of its", "G2 is clipped"]),
    ],
)
def test_readings_that_cannot_be_right_are_named(project, mistake, words):
    head, values = rows(project)
    mistake(values)
    rewrite(project, head, values)
    found = said(project)
    assert all(text in found for text in words)


def in_steps(values):
    values[:, 2] = np.repeat(10.0 * np.round(values[::20, 2] / 10.0), 20)[: len(values)]


def with_a_peak_of_999(values):
    values[:, 1] *= 999.0 / np.nanmax(np.abs(values[:, 1]))


@pytest.mark.parametrize(("unusual", "warned"), [(in_steps, "clipped"), (with_a_peak_of_999, "")])
def test_readings_that_happen_to_look_so_are_readings(project, unusual, warned):
    head, values = rows(project)
    unusual(values)
    rewrite(project, head, values)
    assert warned not in said(project) if warned else said(project) == ""


def test_strain_that_is_taken_for_um_per_m_is_below_all_amplifiers(project):
    head, values = rows(project)
    values[:, 1:] *= 1e-6
    rewrite(project, ",".join(name.partition(" [")[0] for name in head.split(",")), values)
    assert "no amplifier shows less than 0.01 um/m" in said(project)


def test_a_clock_that_is_too_slow_for_a_load_is_warned_of(project):
    head, values = rows(project)
    rewrite(project, head, values[::40])
    assert "which folds back: record faster" in said(project)


@pytest.mark.parametrize(("old", "new", "words"), [("0.010,", "0.009,", "stands twice"), ("0.010,", "0.0004,", "steps back")])
def test_a_repeated_time_and_a_broken_clock_are_refused(project, old, new, words):
    text = (project / "test.csv").read_text(encoding="utf-8")
    assert text.count(f"\n{old}") == 1
    (project / "test.csv").write_text(text.replace(f"\n{old}", f"\n{new}"), encoding="utf-8")
    assert words in said(project)


def test_a_history_with_a_mark_is_refused_at_its_line(project):
    (project / "f.csv").write_text(HISTORY["f.csv"].replace("0.100,0.5000", "0.100,-9999"), encoding="utf-8")
    found = said(project, history())
    assert "f.csv:102  loads.tip.signal" in found
    assert "'F' reads -9999" in found
