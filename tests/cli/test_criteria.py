"""Layouts by every criterion and over some of the unknowns, from the config to the artefact."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

from ..shared import ROOT, made

CONFIG = ROOT / "configs" / "cantilever-input-youngs-modulus.yaml"
LESS = ("train.duration=0.1", "screen.keep=24", "place.instants=2", "rom.parameter_samples=1", "validate.truth.modes=20")
BOTH = ["tip", "E"]
WORST, FAILURE = ("place.criterion=worst_eigenvalue", "place.aggregate=worst"), "place.optimise=worst_failure"


def determinant(M):
    return np.linalg.det(M) ** (1 / len(M))


def largest(M):
    return np.linalg.norm(M, 2)


def metric(place, rows, criterion, combine):
    """The metric of some pool rows from the stored F, H, Q, R, scale and weight alone, by scipy's solver."""
    own, values = np.isin(place["/pool/row"], rows), []
    stored = (place[f"/augmented/{key}"] for key in ("F", "H", "Q", "R", "weight"))
    for F, H, Q, R, weight in zip(*stored, strict=True):
        rows_at_unit_noise = H[own] / np.sqrt(R[own])[:, None]
        P = solve_continuous_are(F.T, rows_at_unit_noise.T, Q, np.eye(len(rows_at_unit_noise)))
        at, root = weight > 0, np.sqrt(weight[weight > 0])
        values.append(criterion(P[np.ix_(at, at)] * np.outer(root, root)))
    return combine(values)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "over", "criterion", "combine"),
    [
        (("place.metric_over=[E]",), ["E"], np.trace, np.mean),
        (("place.criterion=log_determinant",), BOTH, determinant, np.mean),
        (WORST, BOTH, largest, np.max),
        ((WORST[0], "place.metric_over=[tip]", FAILURE), ["tip"], largest, np.mean),
    ],
    ids=["trace of E", "log-determinant", "worst eigenvalue", "worst failure"],
)
def test_artefact_contains_value_of_configured_criterion(changes, over, criterion, combine):
    place = made(CONFIG, *LESS, *changes, until="place", beside="criteria")["place"]
    key = "trace" if criterion is np.trace else "metric"
    said, final = place.summary, place["/selected/final/gauge"]
    expected = metric(place, final, criterion, combine)
    assert said[f"{key}_final"] == pytest.approx(expected, rel=1e-5)
    whole = metric(place, np.arange(said["pool"]), criterion, combine)
    assert place[f"/elimination/{key}"][0] == pytest.approx(whole, rel=1e-5)
    assert place["/elimination/unknowns"].tolist() == over
    assert said["lower_bound"] <= said[f"{key}_final"] * (1 + 1e-12)
    assert said["gap"] == pytest.approx(1 - said["lower_bound"] / said[f"{key}_final"], abs=1e-9)
    assert place["/criteria/value"][0, 0] == pytest.approx(expected, rel=1e-5)
    without = [metric(place, final[final != g], criterion, combine) for g in final]
    np.testing.assert_allclose(place["/failure/loss"], without, rtol=1e-4)
    # of the criteria, the one it was chosen by makes no layout of its own beside this one
    assert place["/criteria/name"][0] == said["criterion"]
    assert set(place["/criteria/rule"].tolist()) > set(place["/criteria/name"][1:].tolist())
    assert said["criterion"] not in place["/criteria/rule"]


@pytest.mark.parametrize(
    ("asked", "key"),
    [
        ("place.criterion=determinant", "place.criterion"),
        ("place.metric_over=[E, tipp]", "place.metric_over[1]"),
        ("place.metric_over=[E, E]", "place.metric_over[1]"),
        ("place.optimise=trace", "place.optimise"),
    ],
)
def test_invalid_criterion_is_refused_with_key(asked, key):
    with pytest.raises(ConfigError) as refused:
        load_config(CONFIG, [asked])
    assert refused.value.key == key
