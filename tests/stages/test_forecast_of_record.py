"""The bar of a long record goes by the clock: its shares are those of the time that parts take."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from strainsight.cases.structure.forecast import CHECK, CHECKED, FILTERED, HELD, LATER, REST, paced


def said_of(passes: int, hold_out: bool) -> dict[float, float]:
    """Share of a short record → what is said of one whose filter and smoother take 100 s, 10 s having been spent."""
    said: list[float] = []
    using = SimpleNamespace(progress=lambda doing, share: said.append(share), files={}, notice=None, sweep=None)
    own = paced(using, 10.0, 100.0, passes, hold_out)
    shares = (CHECKED, FILTERED, (FILTERED + LATER) / 2, LATER, HELD, 1.0)
    for share in shares:
        own.progress("", share)
    return dict(zip(shares, said, strict=True))


def test_a_part_has_the_share_of_the_time_that_it_takes():
    total = 10 + 100 * (CHECK + 1 + REST)
    found = said_of(1, False)
    assert found[CHECKED] == pytest.approx(10 / total)
    assert found[FILTERED] == pytest.approx((10 + 100 * CHECK) / total)
    assert found[LATER] - found[FILTERED] == pytest.approx(100 / total)
    assert found[(FILTERED + LATER) / 2] == pytest.approx((found[FILTERED] + found[LATER]) / 2)
    assert found[1.0] == 1.0


def test_gauges_that_are_left_out_are_as_many_passes():
    total = 10 + 100 * (CHECK + 5 + REST)
    found = said_of(5, True)
    assert found[HELD] - found[LATER] == pytest.approx(400 / total)
    assert 1 - found[HELD] == pytest.approx(100 * REST / total)
