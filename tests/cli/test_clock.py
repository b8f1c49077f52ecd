"""Time left: from the last time, from the share done, or not at all."""

from __future__ import annotations

import pytest

from strainsight.workflow.stage import Stage
from strainsight_cli.clock import Left, after, ends_at, spelt


@pytest.mark.parametrize(
    ("spent", "share", "last", "end"),
    [
        (5.0, 0.9, 60.0, 60.0),  # it took a minute last time: shares are no shares of the time
        (70.0, 0.7, 60.0, 100.0),  # longer than last time: what the share says
        (10.0, 0.25, None, 40.0),
        (1.0, 0.5, None, None),  # too early to say
        (10.0, 0.05, None, None),
        (70.0, 0.0, 60.0, None),
        (10.0, 1.5, None, 10.0),
    ],
)
def test_the_end_of_a_stage(spent, share, last, end):
    found = ends_at(1000.0, 1000.0 + spent, share, last)
    assert found == (None if end is None else pytest.approx(1000.0 + end))


def stage(name: str, *upstream: str) -> Stage:
    return Stage(name, 1, (), upstream, (), lambda context: None)


def test_only_what_follows_from_the_stage_is_added():
    stages = (stage("import"), stage("rom", "import"), stage("other", "import"), stage("place", "rom"))
    last = {"import": 1.0, "rom": 2.0, "other": 4.0, "place": 8.0}
    assert after(stages, "rom", last) == 8.0
    assert after(stages, "import", last) == 14.0
    assert after(stages, "place", last) == 0.0
    del last["place"]
    assert after(stages, "rom", last) is None


def test_it_counts_down_and_is_silent_where_nothing_is_known():
    left = Left(1072.0, 3600.0)
    assert left.text(1000.0) == "about 1:12 left, then 1:00:00"
    assert left.text(1071.0) == "about 0:01 left, then 1:00:00"
    assert left.text(1073.0) == ""
    assert Left(None, 30.0).text(0.0) == ""
    assert Left(1010.0, None).text(1000.0) == "about 0:10 left"
    assert spelt(59.6) == "1:00"
