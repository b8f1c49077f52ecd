"""Files of a test: read right, or refused with the line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight import memory

from ..measurements.written import mat73, mdf, signal
from .tested_beam import as_written, estimated, result, table, validated, write

pytestmark = pytest.mark.usefixtures("no_hot_spots")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return validated(tmp_path_factory.mktemp("test"), {})


@pytest.fixture(scope="module")
def plain(project):
    return as_written(project)


@pytest.mark.slow
def test_a_tenth_of_the_samples_may_be_missing(project, plain, tmp_path):
    head, values = table(project)
    rng = np.random.default_rng(1)
    gauges = [i for i, h in enumerate(head) if h.startswith("G")]
    for i in gauges:
        values[rng.random(len(values)) < 0.1, i] = np.nan
    code, said = estimated(project, write(tmp_path / "missing.csv", head, values))
    assert code == 0, said
    assert "samples are missing" in said
    found = result(project)["/smoothed/side"]
    assert np.linalg.norm(found - plain[1]["/smoothed/side"]) < 0.02 * np.linalg.norm(found)


@pytest.mark.slow
def test_an_unknown_offset_is_found(project, plain, tmp_path):
    head, values = table(project)
    at = [h.startswith("G1") for h in head].index(True)
    offset = 20 * np.nanstd(np.diff(values[:, at]))
    values[:, at] += offset
    file = write(tmp_path / "offset.csv", head, values)
    code, said = estimated(
        project, file, f"estimate.channels.0={{channel: G1, gauge: G1, unit: m/m, bias: {2 * offset:.3e}}}"
    )
    assert code == 0, said
    found = result(project)
    assert found["/bias/mean"][0] == pytest.approx(offset, abs=4 * found["/bias/std"][0])
    assert found["/bias/std"][0] < 0.1 * offset
    assert np.linalg.norm(found["/smoothed/side"] - plain[1]["/smoothed/side"]) < 0.1 * np.linalg.norm(
        found["/smoothed/side"]
    )


def test_a_clock_that_jumps_back_is_refused_with_its_line(project, tmp_path):
    head, values = table(project)
    at = [h.startswith("time") for h in head].index(True)
    values[100:, at] -= 0.05
    code, said = estimated(project, write(tmp_path / "jump.csv", head, values))
    assert code == 2
    assert "jump.csv:102" in said


def test_a_record_too_long_for_the_memory_is_refused_before_it_is_filtered(project, monkeypatch):
    """200 steps: mean and σ of filter and smoother with copies of them, and a dozen numbers for each of four channels."""
    monkeypatch.setattr(memory, "available_memory", lambda: 1e5)
    code, said = estimated(project, project / "results" / "test" / "measured.csv", "--force")
    assert code == 2
    states, needed = re.search(
        r"200 steps of (\d+) states: (\S+) GiB of memory are needed, 9.31e-05 GiB", said
    ).groups()
    assert float(needed) == pytest.approx(8 * 200 * (8 * int(states) + 12 * 4) / 2**30, rel=0.01)
    assert "give a part of the record at a time" in said


@pytest.mark.parametrize(
    ("settings", "key", "says"),
    [
        (["estimate.channels.0.gauge=G9"], "estimate.channels.0.gauge", "G9"),
        (["estimate.channels.1.gauge=G1"], "estimate.channels", "one grid"),
        (["estimate.channels.0.unit=mV/V"], "estimate.channels.0", "bridge"),
        (["estimate.inputs={}"], "estimate.inputs", "tip"),
        (["estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]"], "estimate.channels", "cannot tell"),
        (["estimate.virtual=[{position: [1, 1, 1], direction: [1, 0, 0]}]"], "estimate.virtual.0", "surface"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_key(project, settings, key, says):
    code, said = estimated(project, project / "results" / "test" / "measured.csv", *settings)
    assert code == 2, said
    assert key in said
    assert says in said


def columns(project):
    """Name → values, unit, of the file that validate writes."""
    head, values = table(project)
    names, units = zip(*(column.rstrip("]").split(" [") for column in head), strict=True)
    return {name: (values[:, i], unit) for i, (name, unit) in enumerate(zip(names, units, strict=True))}


def written(path, found):
    t = found["time"][0]
    channels = {name: column for name, column in found.items() if name != "time"}
    if path.suffix == ".mf4":
        signals = [
            signal(name, np.nan_to_num(values), t, unit, invalidation_bits=np.isnan(values))
            for name, (values, unit) in channels.items()
        ]
        return mdf(path, ("rig", signals))
    variables = {name: values for name, (values, _) in found.items()}
    return mat73(path, variables | {"units": {name: unit for name, (_, unit) in channels.items()}})


@pytest.mark.parametrize("name", ["a.mf4", "73.mat"])
@pytest.mark.slow
def test_the_estimate_is_that_of_the_csv_file(project, plain, tmp_path, name):
    file = written(tmp_path / name, columns(project))
    code, said = estimated(project, file, *([] if file.suffix == ".mat" else ["estimate.time.channel=null"]))
    assert code == 0, said
    found = result(project)
    for dataset, values in plain[1].items():
        np.testing.assert_allclose(found[dataset], values, rtol=1e-6, atol=1e-9 * np.abs(values).max())


def test_several_rates_end_with_channels_and_rates(project, tmp_path):
    found = columns(project)
    t = found["time"][0]
    signals = [signal(name, np.nan_to_num(found[name][0]), t, found[name][1]) for name in ("G1", "G2", "G3", "G4")]
    slow = [signal("tip", found["tip"][0][::5], t[::5], "N")]
    code, said = estimated(
        project, mdf(tmp_path / "a.mf4", ("gauges", signals), ("shaker", slow)), "estimate.time.channel=null"
    )
    said = " ".join(said.split())
    assert code == 2
    assert "2 sampling rates: 1000 Hz ('G1', 'G2', 'G3', 'G4'), 200 Hz ('tip')" in said
    assert "resampled to one" in said

