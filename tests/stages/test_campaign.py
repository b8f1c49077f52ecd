"""Several records of a test in one estimate, from the command line: table, verdicts, pages, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from .tested_beam import changed, table, write

pytestmark = pytest.mark.usefixtures("no_hot_spots")

NAMES = ("low", "mid", "high")
TRUTH = 2.1e11
LINES = "".join(f"    - {{name: {name}, file: {name}.csv, date: day {i}}}\n" for i, name in enumerate(NAMES))
RECORDS = f"  records:\n{LINES}"
PLACE = "  as_placed: true\n"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The thirds of a simulated test, as records of their own."""
    folder = tmp_path_factory.mktemp("campaign")
    changed(folder, "test", {})
    head, rows = table(folder)
    count = (len(rows) - 1) // 3
    for i, name in enumerate(NAMES):
        write(folder / f"{name}.csv", head, rows[i * count : (i + 1) * count + 1])
    return folder


def run(project, records=RECORDS, *options, also=()):
    """The config with these records; what `estimate` says of it, and its artefact, None where there is none."""
    text = (project / "test.yaml").read_text().replace(PLACE, PLACE + records)
    for old, new in also:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (project / "campaign.yaml").write_text(text)
    command = ["estimate", str(project / "campaign.yaml"), "--results", str(project / "results"), *options]
    done = CliRunner().invoke(app, [*command, "--no-page"])
    said = done.output + (done.stderr or "")
    assert "Traceback" not in said
    written = project / "results" / "test" / "estimate.h5"
    return done.exit_code, " ".join(said.split()), Artefact(written) if written.is_file() else None


@pytest.fixture(scope="module")
def found(project):
    code, said, artefact = run(project)
    assert code == 0, said
    return said, dict(artefact.summary), {path: artefact[path].copy() for path in artefact.paths()}


@pytest.mark.slow
def test_one_modulus_is_found_by_all_records_and_each_has_loads_that_is_separate(found):
    said, numbers, arrays = found
    assert numbers["records"] == 3
    assert numbers["trusted"]
    assert abs(numbers["estimate.E"] - TRUTH) < 3 * numbers["std.E"]
    assert list(arrays["/records"]) == list(NAMES)
    for name in NAMES:
        np.testing.assert_allclose(arrays[f"/record/{name}/smoothed/E"], numbers["estimate.E"], rtol=1e-9)
        size = np.sqrt(np.mean(arrays[f"/record/{name}/smoothed/side"] ** 2))
        assert numbers[f"estimate.side.{name}"] == pytest.approx(size)
    assert f"E {numbers['estimate.E']:.4g} ± {numbers['std.E']:.2g} Pa" in said


@pytest.mark.slow
def test_status_and_view_report_which_record(project, found, tmp_path):
    config, results = str(project / "campaign.yaml"), ["--results", str(project / "results")]
    status = CliRunner().invoke(app, ["status", config, *results])
    assert "3 records (low, mid, high)" in " ".join(status.output.split())
    picture = str(tmp_path / "view.png")
    done = CliRunner().invoke(app, ["view", config, *results, "--record", "mid", "--screenshot", picture])
    assert "record mid of low, mid, high" in done.output, done.output
    wrong = CliRunner().invoke(app, ["view", config, *results, "--record", "midd", "--screenshot", picture])
    assert wrong.exit_code == 2
    assert "you mean mid?" in wrong.output + (wrong.stderr or "")


@pytest.mark.slow
def test_one_record_is_the_test_of_its_file(project):
    code, said, one = run(project, "  records: [{name: low, file: low.csv}]\n")
    assert code == 0, said
    numbers, arrays = dict(one.summary), {path: one[path].copy() for path in one.paths()}
    code, said, file = run(project, "  file: low.csv\n")
    assert code == 0, said
    assert set(file.paths()) == set(arrays)
    assert dict(file.summary) == numbers
    for path, values in arrays.items():
        np.testing.assert_array_equal(values, file[path])


def read(project, name):
    lines = (project / f"{name}.csv").read_text().splitlines()
    return lines[0].split(","), np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines[1:]])


def shortened(project, name, of, samples, column="", factor=1.0):
    """A record of the first samples of another one, one of its columns times a factor."""
    head, rows = read(project, of)
    if column:
        rows[:, [title.startswith(column) for title in head]] *= factor
    write(project / f"{name}.csv", head, rows[:samples])


@pytest.mark.slow
def test_a_channel_that_is_wrong_in_one_record_is_named_with_it_and_can_be_put_right_there(project):
    shortened(project, "wrong", "mid", 61, "G2", -1.0)
    shortened(project, "short", "low", 61)
    records = "  records: [{name: low, file: short.csv}, {name: mid, file: wrong.csv}]\n"
    code, said, artefact = run(project, records)
    assert code == 3
    assert "record 'mid': the measurements are inconsistent with the model: G2 has the opposite sign" in said
    assert "estimate.records.1.channels.1.sign: -1" in said
    assert not artefact.summary["trusted"]
    assert artefact.summary["trusted.low"]
    for name in ("low", "mid"):
        assert np.isnan(artefact[f"/record/{name}/smoothed_std/E"]).all()
    found = artefact.summary["estimate.E"]
    np.testing.assert_allclose(artefact["/record/low/smoothed/E"], found, rtol=1e-9)
    # the wrong record tells the other nothing of the modulus
    wrong = artefact.summary["alone.E.mid"]
    _, _, by_itself = run(project, "  records: [{name: low, file: short.csv}]\n")
    assert by_itself.summary["estimate.E"] == pytest.approx(found, rel=1e-12)
    assert abs(wrong / found - 1) > 0.02
    entries = ", ".join(
        f"{{channel: G{i}, gauge: G{i}, unit: m/m{', sign: -1' * (i == 2)}}}" for i in range(1, 5)
    )
    put_right = records.replace("wrong.csv}", f"wrong.csv, channels: [{entries}]}}")
    code, said, artefact = run(project, put_right)
    assert code == 0, said
    assert artefact.summary["trusted"]


def test_records_of_different_parts_disagree_with_each_other(project):
    """The known load is 10 % too small in one: alone it says a tenth less of the modulus."""
    shortened(project, "other", "mid", 101, "tip", 0.9)
    shortened(project, "half", "low", 101)
    code, said, _ = run(project, "  records: [{name: low, file: half.csv}, {name: mid, file: other.csv}]\n")
    assert code == 3
    assert "estimate.records: the records are inconsistent with each other. Separate estimates: E" in said


def one_more(line):
    return RECORDS + f"    - {line}\n"


@pytest.mark.parametrize(
    ("records", "also", "key", "remedy"),
    [
        (one_more("{name: more, file: low.csv}"), (), "estimate.records[3].file", "one of the two"),
        (one_more("{name: more, file: absent.csv}"), (), "estimate.records.3.file", "relative to the folder of the config"),
        ("  file: low.csv\n" + RECORDS, (), "estimate.records", "remove estimate.records, or estimate.file"),
        (
            one_more("{name: more, file: more.csv, channels: [{channel: G1, gauge: G1, unit: m/m}]}"),
            (),
            "estimate.records[3].channels",
            "the same gauges and measuring grids as in estimate.channels, in the same order",
        ),
        (RECORDS, [("validate:\n", "filter: {method: extended}\nvalidate:\n")], "estimate.records", "filter.method: grid"),
        (RECORDS + "  tune: {parts: [noise]}\n", (), "estimate.tune.parts", "estimate.file"),
    ],
)
def test_what_cannot_be_is_refused_with_its_key(project, records, also, key, remedy):
    code, said, _ = run(project, records, also=also)
    assert code == 2, said
    assert f"{key}: " in said
    assert remedy in said


def test_a_channel_that_one_file_lacks_is_named_with_the_record(project):
    head, rows = read(project, "high")
    write(project / "fewer.csv", head[:-1], rows[:, :-1])
    code, said, _ = run(project, "  records: [{name: low, file: low.csv}, {name: high, file: fewer.csv}]\n")
    assert code == 2
    assert "record 'high': " in said


def test_a_file_on_the_command_line_is_not_put_with_records(project):
    code, said, _ = run(project, RECORDS, "--measurements", str(project / "low.csv"))
    assert code == 2
    assert "estimate.records: cannot be combined with estimate.file (low.csv)" in said


@pytest.mark.slow
def test_each_record_has_its_factor_on_field_sigma(project):
    """The RMS of error/σ of its held-out channels, where they are overconfident; its σ is that without hold-out times it."""
    shortened(project, "short", "low", 61)
    shortened(project, "off", "mid", 61, "G3", 1.1)
    records = "  accept_inconsistent: true\n  records: [{name: low, file: short.csv}, {name: off, file: off.csv}]\n"
    code, said, artefact = run(project, records)
    assert code == 0, said
    plain = {name: artefact[f"/record/{name}/virtual/std"].copy() for name in ("low", "off")}
    code, said, artefact = run(project, records, "--set=estimate.hold_out=each")
    assert code == 0, said
    factors = {}
    for name, std in plain.items():
        found = {path: artefact[f"/record/{name}{path}"] for path in ("/hold_out/predicted", "/hold_out/std", "/gauge/measured")}
        predicted, sigma, measured = found.values()
        s = np.sqrt(np.mean(((predicted - measured) / sigma) ** 2, axis=0).mean())
        factors[name] = artefact.summary[f"hold_out.field_factor.{name}"]
        assert factors[name] in (1.0, pytest.approx(s, rel=1e-12))
        applied = factors[name] if factors[name] <= 3 else np.nan
        np.testing.assert_allclose(artefact[f"/record/{name}/virtual/std"], applied * std, rtol=1e-12)
    assert factors["off"] > max(1.0, factors["low"])
    assert "off: σ of strain, stress and damage at positions without gauges" in said
