"""A parameter of a validation that has left the range which the reduced model was made for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.cases.structure.out_of_range import validated_out_of_range
from strainsight.config.load import load_config
from strainsight.records.record import read
from strainsight.records.validated import Validated

from ..edges.beam import E, bricks, finished
from .decks import config


@pytest.mark.parametrize(("value", "said"), [(2.9e11, False), (3.1e11, True), (0.9e11, True)])
def test_it_is_named_with_its_range_and_the_key(tmp_path, value, said):
    (tmp_path / "own.yaml").write_text(config(), encoding="utf-8")
    model = SimpleNamespace(damping=SimpleNamespace(parameter=None))
    problem = SimpleNamespace(unknowns=SimpleNamespace(parameters=("E",)), model=model)
    found = validated_out_of_range(load_config(tmp_path / "own.yaml").model, problem, {"E": value})
    assert bool(found) == said
    if said:
        assert f"E came out at {value:.4g} Pa, and rom made the model for 1e+11 to 3e+11" in found
        assert "widen parameters.E.range" in found


def test_a_validation_withholds_sigma_there_and_says_it_first(tmp_path):
    """No estimate from noise lies in a range so narrow."""
    changes = {"parameters.E.range": [E * (1 - 1e-9), E * (1 + 1e-9)], "parameters.E.guess": E}
    found = finished(tmp_path, "report", bricks((5, 1, 1)), changes)
    summary, page = found["validate"].summary, (found["report"].path.parent / "report.html").read_text(encoding="utf-8")
    assert str(summary["out_of_range"]).startswith("σ is withheld: E came out at 2.")
    assert summary["verdict"] == "σ is withheld"
    assert not [key for key in summary if key.split(".")[0] in ("claim", "std", "smoothed_std")]
    own = read(Validated, found["validate"])
    for std in (*own.std.values(), *own.smoothed_std.values(), *own.noise.std.values(), own.gauge.std, own.field.std):
        assert np.isnan(std).all()
    assert "E: σ is withheld" in page
    assert "claimed σ)" not in page
