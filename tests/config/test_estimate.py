"""The section `estimate` of a config."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from strainsight.config.estimate import Clock


@pytest.mark.parametrize(
    ("stated", "hertz"),
    [({"rate": 100}, 100.0), ({"rate": 100, "unit": "Hz"}, 100.0), ({"rate": 1.2, "unit": "kHz"}, 1200.0), ({}, None)],
)
def test_a_rate_is_in_hertz_unless_stated(stated, hertz):
    assert Clock(**stated).hertz == hertz


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"rate": 100, "channel": "t"}, "either `channel` or `rate`"),
        ({"rate": 100, "unit": "ms"}, "a rate in ms"),
        ({"rate": 0}, "greater than 0"),
    ],
)
def test_a_clock_is_a_channel_or_a_rate(stated, message):
    with pytest.raises(ValidationError, match=message):
        Clock(**stated)
