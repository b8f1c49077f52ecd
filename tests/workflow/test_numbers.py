"""A stage whose numbers have changed has another version: without one, artefacts of before are taken for up to date."""

from __future__ import annotations

import json

from .numbers import KEPT, differs, numbers_of


def test_numbers_change_with_the_version_of_their_stage_alone(tmp_path):
    """Those of all stages of a small beam and a small bench are kept in numbers.json, with the versions that made them."""
    kept, found = json.loads(KEPT.read_text(encoding="utf-8")), numbers_of(tmp_path)
    raised = [stage for stage, own in found.items() if own["version"] != kept.get(stage, {}).get("version")]
    assert not raised, f"{raised} have a new version: renew numbers.json, python -m tests.workflow.numbers"
    moved = {
        stage: [
            path
            for path in sorted({*own["numbers"], *kept[stage]["numbers"]})
            if differs(own["numbers"].get(path, [0, 0]), kept[stage]["numbers"].get(path, [-1, 0]))
        ]
        for stage, own in found.items()
    }
    moved = {stage: paths for stage, paths in moved.items() if paths}
    first = next(iter(moved), "")
    assert not moved, f"{first} has other numbers ({moved[first][:6]}) and its version: raise it, then renew numbers.json"


def test_a_number_that_moves_is_seen():
    assert not differs([3, 1.0], [3, 1.0 + 1e-6])
    assert differs([3, 1.0], [3, 1.0 + 1e-4])
    assert differs([3, 1.0], [4, 1.0])
