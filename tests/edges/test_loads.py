"""Several unknown loads of one structure, of very different sizes."""

from __future__ import annotations

import numpy as np
import pytest

from .beam import TIP, bricks, finished

SIZE = {"side": 1000.0, "down": 5.0, "along": 0.0}
"""Amplitude of the true load [N]; the filter takes 20 N for the last one."""


def test_each_load_is_judged_by_its_own_size_and_one_that_is_zero_by_its_amplitude(tmp_path):
    """RMS of error and σ after the first tenth, read off the histories."""
    (tmp_path / "zero.csv").write_text("time [s],force [N]\n0,0\n0.05,0\n0.1,0\n", encoding="ascii")
    loads = {
        name: {
            "node": TIP,
            "direction": np.roll([1.0, 0.0, 0.0], i).tolist(),
            "known": False,
            "signal": {"type": "sine", "frequency": 20.0 + 5.0 * i, "amplitude": size}
            if size
            else {"type": "csv", "file": "zero.csv", "time_column": "time", "value_column": "force"},
            "process_noise": {"model": "integrated_random_walk"}
            | ({} if size else {"frequency": 20.0, "amplitude": 20.0}),
        }
        for i, (name, size) in enumerate(SIZE.items(), start=1)
    }
    names = list(loads)
    changes = {
        "parameters": {},
        "loads": loads,
        "screen.keep": "all",
        "place.estimate": names,
        "place.keep": 5,
        "validate.truth.parameters": {},
        "validate.initial_std": dict.fromkeys(names, 0.1),
        "validate.repeats": 3,
        "tolerances": "none",
    }
    validate = finished(tmp_path, "validate", bricks((6, 2, 2)), changes)["validate"]
    for name, size in SIZE.items():
        truth, late = validate[f"/truth/{name}"], slice(11, None)  # of 101 instants
        own = np.sqrt(np.mean(truth[late] ** 2)) if size else 20.0
        assert validate.summary[f"scale.{name}"] == pytest.approx(own)
        assert validate.summary[f"zero.{name}"] == (size == 0)
        for key, history in (
            ("error", validate[f"/estimate/{name}"] - truth),
            ("std", validate[f"/std/{name}"]),
            ("smoothed", validate[f"/smoothed/{name}"] - truth),
            ("smoothed_std", validate[f"/smoothed_std/{name}"]),
        ):
            assert validate.summary[f"{key}.{name}"] == pytest.approx(np.sqrt(np.mean(history[late] ** 2)) / own)
        # Nothing here is nonlinear: with everything exact σ is the same whatever the noise and the start.
        np.testing.assert_allclose(validate[f"/repeats/std/{name}"], validate.summary[f"std.{name}"], rtol=1e-6)
    assert "of its amplitude, 20 N," in validate.message
