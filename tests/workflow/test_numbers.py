"""A stage whose numbers have changed has another version: without one, artefacts of before are taken for up to date."""

from __future__ import annotations

import json

import numpy as np
import pytest

from .numbers import KEPT, differs, numbers_of, size


def test_numbers_change_with_the_version_of_their_stage_alone(tmp_path):
    """Those of all stages of a small beam and a small bench are kept in numbers.json, with the versions that made them."""
    kept, found = json.loads(KEPT.read_text(encoding="utf-8")), numbers_of(tmp_path)
    raised = [stage for stage, own in found.items() if own["version"] != kept.get(stage, {}).get("version")]
    assert not raised, f"{raised} have a new version: renew numbers.json, python -m tests.workflow.numbers"
    moved = {
        stage: [
            path
            for path in sorted({*own["numbers"], *kept[stage]["numbers"]})
            if differs(own["numbers"].get(path, [0, 0, 0]), kept[stage]["numbers"].get(path, [-1, 0, 0]))
        ]
        for stage, own in found.items()
    }
    moved = {stage: paths for stage, paths in moved.items() if paths}
    first = next(iter(moved), "")
    assert not moved, f"{first} has other numbers ({moved[first][:6]}) and its version: raise it, then renew numbers.json"


def test_a_number_that_moves_is_seen():
    assert not differs([3, 1.0, 0.1], [3, 1.0 + 1e-6, 0.1 + 1e-6])
    assert differs([3, 1.0, 0.1], [3, 1.0 + 1e-4, 0.1])
    assert differs([3, 1.0, 0.1], [4, 1.0, 0.1])
    assert differs([3, 1.0, 0.1], [3, 1.0, 0.1 + 1e-4])


@pytest.mark.parametrize("shape", [(7,), (3, 2), (40, 25), (300, 300)])
@pytest.mark.parametrize("change", ["sign", "one sign", "order", "two exchanged", "rounding"])
def test_a_flipped_sign_and_a_swapped_order_are_seen_and_rounding_is_not(shape, change):
    x = 1e-6 * np.random.default_rng(0).standard_normal(shape)
    y = x.copy().ravel()
    if change == "sign":
        y = -y
    elif change == "one sign":
        y[np.argmax(np.abs(y))] *= -1
    elif change == "order":
        y = y[::-1]
    elif change == "two exchanged":
        low, high = np.argmin(y), np.argmax(y)
        y[[low, high]] = y[[high, low]]
    else:
        y *= 1 + 1e-7 * np.random.default_rng(1).uniform(-1, 1, y.shape)
    assert differs(size(y.reshape(shape)), size(x)) == (change != "rounding")


def test_where_a_number_is_missing_counts():
    assert differs(size(np.array([np.nan, 1.0, 2.0])), size(np.array([1.0, np.nan, 2.0])))
