"""The page of a bench: gauges placed on its hub, the loads estimated, stress on the body."""

from __future__ import annotations

import h5py
import pytest

from ..shared import BENCHES, ROOT, made
from . import answers, space, tables
from .every import *  # noqa: F403  every page has to pass these

pytestmark = pytest.mark.slow
SHORT = ("simulate.duration=2.0", "estimate.time_step=0.1", "field.instants=5")


@pytest.fixture(scope="module")
def report():
    """Of a run that takes the reduced hub of other benches over."""
    run = made(ROOT / "configs" / "bench" / "gauges.yaml", *SHORT, "name=bench-gauges", beside=BENCHES)
    return run["report"].path.parent / "report.html"


def test_its_answer_has_the_numbers_of_the_estimate(look, report):
    """What does not hold, then how many channels tell which load, with which error, at which claimed σ; up to which
    frequency, and the largest stress, in this order."""
    with h5py.File(report.parent / "estimate.h5") as artefact:
        told = artefact["summary"].attrs
        wrong = [name for name in ("Fx", "Fy", "Fz") if told[f"claim.{name}"] == "overconfident"]
        expected = [told[f"claim_{key}.{name}"] for name in wrong for key in ("ratio", "most")]
        expected.append(told["channels"])
        for name in ("Fx", "Fy", "Fz"):
            expected += [told[f"error.{name}"], told[f"std.{name}"]]
    for stage, name in (("simulate", "band"), ("field", "von_mises")):
        with h5py.File(report.parent / f"{stage}.h5") as artefact:
            expected.append(artefact["summary"].attrs[name])
    numbers = answers.sentence(look(report))
    assert [number.value for number in numbers] == pytest.approx([float(value) for value in expected], rel=1e-12)


def test_the_body_turns_and_its_gauges_are_picked(look, report):
    found = look(report)
    space.shows_a_structure(found)
    space.turns_under_the_mouse(found)
    space.picks_gauges(found, space.gauges_of_bench(report.parent, "gauges"))


def test_its_shapes_move(look, report):
    found = look(report, still=True)
    space.shows_strain(found)
    space.moves_in_its_shapes(found)


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    assert tables.all_work(look(report).page, "bench-gauges")
