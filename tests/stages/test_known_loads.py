"""Known loads of a test as loggers write them: slower than the gauges, repeated, reversed, late, in another unit."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.workflow.artefact import Artefact

from ..shared import slowly
from .tested_beam import KNOWN, changed, estimated, table, write

pytestmark = pytest.mark.usefixtures("no_hot_spots")
TRUE = 2.1e11
FAST = {
    "frequency: 20.0, amplitude: 1.0e+4": "frequency: 60.0, amplitude: 1.0e+4",
    "load_position: 0}": "load_position: 0, frequency: 0}",
}
"""A thirtieth of the sampling rate, of a model with the true frequencies."""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loads")
    changed(folder, "known", KNOWN | FAST)
    return folder


def with_load(project, name, change, gauges=lambda y: y):
    head, values = table(project, "known")
    values[:, -1] = change(values[:, -1])
    values[:, 1:-1] = gauges(values[:, 1:-1])
    return write(project / f"{name}.csv", head, values)


def found_of(project, file, *settings):
    code, said = estimated(project, file, *settings, config="known.yaml")
    return code, " ".join(said.split())


def modulus(project):
    found = Artefact(project / "results" / "known" / "estimate.h5")
    return float(found["/smoothed/E"][-1]), float(found["/std/E"][-1])


def right(project):
    value, std = modulus(project)
    return abs(value - TRUE) < 2 * std < 0.02 * TRUE


def blanks(u):
    return np.where(np.arange(len(u)) % 5 == 0, u, np.nan)


def repeated(u):
    return u[np.arange(len(u)) // 4 * 4]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        *slowly((lambda u: u, ""), (blanks, "missing samples were interpolated")),
        (repeated, "tip: its samples come in runs of 4 equal ones, a channel of 500 Hz"),
    ],
)
def test_a_slower_load_gives_the_modulus(project, change, says):
    code, said = found_of(project, with_load(project, "slower", change))
    assert code == 0, said
    assert says in said
    assert right(project)


def test_a_load_faster_than_its_samples_is_refused(project):
    noise = 5e3 * np.random.default_rng(1).standard_normal(1000)
    code, said = found_of(project, with_load(project, "rough", lambda u: u + noise[: len(u)]))
    assert code == 2
    assert "of the RMS of 'tip' is beyond 600 Hz, 0.3 of its sampling rate" in said
    assert "estimate.inputs.tip" in said


def test_a_long_gap_is_refused(project):
    def gap(u):
        u = u.copy()
        u[100:120] = np.nan
        return u

    code, said = found_of(project, with_load(project, "gap", gap))
    assert code == 2
    assert "the known load 'tip' lacks 20 samples, 20 in a row, the first at 0.05 s" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says", "settings"),
    [
        (lambda u: -u, "set estimate.inputs.tip.sign: -1", ["estimate.inputs.tip.sign=-1"]),
        (lambda u: 1e-3 * u, "set estimate.inputs.tip.scale: 1000", ["estimate.inputs.tip.scale=1000"]),
        (
            lambda u: np.concatenate([[0, 0], u[:-2]]),
            "tip is 2 samples (0.001 s) late: set estimate.inputs.tip.delay: {samples: 2}, or accept",
            ["estimate.inputs.tip.delay={samples: 2}"],
        ),
        (
            lambda u: np.concatenate([u[2:], [np.nan, np.nan]]),
            "tip is 2 samples (0.001 s) early: set estimate.inputs.tip.delay: {samples: -2}, or accept",
            ["estimate.inputs.tip.delay={samples: -2}"],
        ),
    ],
    ids=["sign", "unit", "late", "early"],
)
def test_what_is_printed_undoes_the_fault_of_a_load(project, change, says, settings):
    file = with_load(project, "wrong", change)
    code, said = found_of(project, file)
    assert code == 3
    assert says in said
    code, said = found_of(project, file, *settings)
    assert code == 0, said
    assert right(project)


@pytest.mark.slow
def test_all_gauges_reversed_name_the_load(project):
    code, said = found_of(project, with_load(project, "reversed", lambda u: u, lambda y: -y))
    assert code == 3
    assert "tip fits with sign −1" in said
