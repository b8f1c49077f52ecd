"""The layout that a config asks for: of least trace, proven, or of least loss after one failure; advice about others."""

from __future__ import annotations

import re
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight import api
from strainsight.errors import InfeasibleError
from strainsight.experiment.layout.advice import Expectation, _failures, _redundant, best_possible
from strainsight.experiment.layout.layout import layout_of
from strainsight.experiment.layout.task import root_of
from strainsight.experiment.structure.screening import COHERENCE
from strainsight.placement.certificate import Certificate, certify
from strainsight.placement.criteria import Trace
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.limits import limits_of
from strainsight.placement.score import score

from ..edges.beam import TIP, bricks, prepared
from ..placement.conftest import beam_of, last, oracle, scenarios_of
from ..placement.whole_pools import eliminate


@pytest.mark.parametrize("seed", range(20))
def test_redundant_gauges_are_consistent_with_the_worst_failure(seed):
    """Growths of two σ from 0.1 % to 1000 %: whose failure costs 5 % of any σ is not redundant."""
    rng, labels = np.random.default_rng(seed), [f"G{i + 1}" for i in range(6)]
    std = {"a": 0.02, "b": 3.0}
    growth = {name: 10 ** rng.uniform(-3, 1, 6) for name in std}
    without = {name: std[name] * (1 + growth[name]) for name in std}
    words = list(_redundant(labels, [(0, 1, 2), (3, 5)], Expectation(std, without)))
    named = [{part.strip() for part in text.split(" are redundant")[0].split(",")} for text in words]
    small = {label for label, a, b in zip(labels, growth["a"], growth["b"], strict=True) if max(a, b) < 0.05}
    expected = [small & {labels[i] for i in group} for group in ((0, 1, 2), (3, 5))]
    assert named == [group for group in expected if len(group) > 1]
    (failure,) = _failures(labels, np.ones(6), std, without)
    size, worst = re.fullmatch(r"If one gauge fails, σ\(\w\) grows by at most (\S+) % \((G\d)\)\.", failure).groups()
    assert float(size) < 5 or not any(worst in group for group in named)


def test_unobservable_gauges_are_not_redundant():
    lost = Expectation({"a": 1.0}, {"a": np.array([np.inf, 1.01, np.nan, 1.02])})
    (sentence,) = _redundant(("G1", "G2", "G3", "G4"), [(0, 1, 2, 3)], lost)
    assert sentence.startswith("G2, G4 are redundant")
    assert sentence.endswith("every σ grows by less than 5 %.")


def test_a_robust_layout_loses_less_in_its_worst_failure_and_both_report_what():
    pools = eliminate(scenarios_of(beam_of(12, 3, seed=0), (), ("E",)), 3).pools

    def layout(optimise):
        asked = SimpleNamespace(keep=3, exchange=True, certificate=True, optimise=optimise, prove=0.0)
        return layout_of(pools, np.arange(3), limits_of(12, 3), asked, "mean", lambda *_: None)

    def failures(gauges):
        return [score(pools, [g for g in gauges if g != out]) for out in gauges]

    plain, robust = layout("metric"), layout("worst_failure")
    for found in (plain, robust):
        np.testing.assert_allclose(loss_if_one_fails(pools, found.gauges), failures(found.gauges.tolist()), rtol=1e-9)
    least = min(max(failures(gauges)) for gauges in combinations(range(12), 3))
    lost, otherwise = (loss_if_one_fails(pools, found.gauges).max() for found in (robust, plain))
    assert least * (1 - 1e-9) <= lost <= otherwise * (1 + 1e-9)
    assert robust.cost >= plain.cost * (1 - 1e-9)
    assert (robust.proof, robust.exchange) == (None, None)


KEEP, TRACE = 4, Trace()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_with_two_unknowns_the_bound_is_on_their_weighted_sum_and_on_no_single_sigma(seed):
    """Of 495 layouts none has a lower sum, or root of it, than is said; one has a σ that is lower by more."""
    greedy = eliminate(scenarios_of(beam_of(12, 3, seed=seed), ("Fz",), ("E",)), KEEP)
    swapped, (pool,), names = exchange(greedy.pools, greedy.selected), greedy.pools, ("Fz", "E")
    (sentence,) = best_possible(certify(greedy.pools, swapped.gauges, swapped.cost[-1]), TRACE, names, root_of(TRACE, names))

    def weighted(gauges):
        P = oracle(pool.scenario, list(gauges))
        return (pool.scenario.weight * np.diag(P))[last(len(P), len(names))]

    ours, every = weighted(swapped.gauges), np.array([weighted(gauges) for gauges in combinations(range(12), KEEP)])
    variance, deviation = map(float, re.findall(r"by more than (\S+) %", sentence))
    assert "reduce the criterion tr(W P) by more than" in sentence
    assert "the weighted RMS of the steady-state σ of Fz and E" in sentence
    least = every.sum(axis=1).min() / ours.sum()
    assert 100 * (1 - least) <= variance * (1 + 1e-6)
    assert 100 * (1 - np.sqrt(least)) <= deviation * (1 + 1e-6)
    single = 100 * (1 - np.sqrt(every.min(axis=0) / ours))
    assert single.max() > deviation
    assert sentence.endswith("A single σ may be reduced by more.")


@pytest.mark.parametrize(
    ("gap", "names", "said"),
    [
        (0.19, ("E",), "reduce the steady-state σ(E) by more than 10 %."),
        (0.1235, ("E",), "reduce the steady-state σ(E) by more than 6.4 %."),  # 1 − √0.8765 = 6.378 %
        (-1e-9, ("E",), "reduce the steady-state σ(E) by more than 0.05 %."),
        (0.1235, ("x", "y", "E"), "13 %, or its root, the weighted RMS of the steady-state σ of x, y and E, by more than 6.4 %."),
    ],
)
def test_shares_are_rounded_up(gap, names, said):
    certificate = Certificate(1 - gap, gap, 1.0, np.ones(1), 1, np.ones(1))
    assert said in next(best_possible(certificate, TRACE, names, root_of(TRACE, names)))


STRONG, WEAK, STEP, DURATION = 1000.0, 1.0, 0.002, 0.2


def load(direction, amplitude, known=False, frequency=10.0):
    signal = {"type": "sine", "frequency": frequency, "amplitude": amplitude}
    return {"node": TIP, "direction": direction, "known": known, "signal": signal}


TWO = {
    "loads": {"down": load([0, 0, 1], STRONG), "aside": load([0, 1, 0], WEAK)},
    "place.estimate": ["down", "aside"],
    "validate.initial_std": {"down": 0.1, "aside": 0.1},
    "validate.truth.parameters": {},
}
PLAIN = {
    "gauges.direction.angles": [0.0],
    "gauges.clearance": "none",
    "gauges.noise_std": {"value": 1e-8},
    "train": {"duration": DURATION, "time_step": STEP},
    "screen.minimum_spacing": 0.0,
}


@pytest.fixture(scope="module")
def screened(tmp_path_factory):
    """Changes → a beam up to its screening."""
    folder = tmp_path_factory.mktemp("beam")
    return lambda changes: prepared(folder, bricks((8, 3, 3)), PLAIN | changes)


def best(ratio, count):
    """So many places (count,), the largest of each row in turn; the beam has places that read alike."""
    found, orders = [], [np.argsort(-np.round(own / own.max(), 7), kind="stable").tolist() for own in ratio]
    while len(found) < count:
        for own in orders:
            if len(found) < count:
                found.append(next(i for i in own if i not in found))
    return sorted(found)


def test_a_weak_load_has_its_share_of_the_candidates(screened):
    """Each load alone, by a run of its own without the other. The strongest hardly feel the weak one: they lie in the axis
    of its bending."""
    own = screened(TWO | {"tolerances": "none"})
    found, training = own.screened, own.training
    alone = []
    for name, other in (("down", "aside"), ("aside", "down")):
        loads = {name: TWO["loads"][name], other: load([1, 0, 0], 1e-12)}
        alone.append(screened(TWO | {"loads": loads, "tolerances": "none"}).training.rms / found.noise_std)
    alone = np.array(alone)
    np.testing.assert_allclose(np.sort(alone[:, found.kept]), np.sort(alone[:, best(alone, 8)]), rtol=1e-6)
    np.testing.assert_allclose(found.snr, np.max(alone, axis=0), rtol=1e-6, atol=1e-6)
    by_strength = screened(TWO | {"screen.by": "strength", "tolerances": "none"}).screened
    assert training.rms[by_strength.kept].min() >= (1 - 1e-6) * np.sort(training.rms)[-8]
    weak = [alone[1][pool.kept].max() for pool in (found, by_strength)]
    assert weak[0] > 1.5 * weak[1]
    run = own.case, own.mesh, own.reduced, training
    both = [api.place(*run, pool).expected.std["aside"] for pool in (found, by_strength)]
    assert both[0] < 0.8 * both[1]


def test_a_modulus_under_a_slow_load_is_seen_in_the_readings_themselves(screened):
    """ε = Hq with Kq = f far below the first mode: θ ∂ε/∂θ = −ε."""
    own = screened({"loads": {"tip": load([0, 0, 1], STRONG, True, 1.0)}, "tolerances": "none"})
    found = own.screened
    np.testing.assert_allclose(found.snr, own.training.rms / found.noise_std, rtol=5e-4, atol=1e-6)
    assert not found.installation.any()


def test_places_of_small_errors_take_turns_with_strong_ones(screened):
    """Of E beside errors of place alone: those that read most over noise, and those over noise and τ v/h, in turn."""
    names = ("angle", "gain", "common_gain", "transverse", "frequency", "load_angle", "load_position", "load_gain", "load_mass")
    exact = dict.fromkeys(names, 0) | {"damping": 1}
    found = screened({"tolerances": exact | {"position": 0.005}}).screened
    rms = found.snr * found.noise_std
    over = np.sqrt(found.noise_std**2 + COHERENCE * DURATION / STEP * found.installation[0])  # √(σ² + τ v/h)
    ratio = np.array([found.snr, rms / over])
    np.testing.assert_allclose(np.sort(ratio[:, found.kept]), np.sort(ratio[:, best(ratio, 8)]), rtol=1e-6)
    assert ratio[1, found.kept].sum() > 1.01 * ratio[1, best(ratio[:1], 8)].sum()
    assert np.all(found.snr >= ratio[1])


def test_an_unknown_that_does_nothing_in_training_is_refused(screened, tmp_path):
    """Its record is zero all along; beside it a known load acts."""
    still = tmp_path / "still.csv"
    still.write_text("t,F\n0,0\n1,0\n", encoding="utf-8")
    own = load([0, 0, 1], STRONG) | {
        "signal": {"type": "csv", "file": str(still), "time_column": "t", "value_column": "F"},
        "process_noise": {"frequency": 10.0, "amplitude": STRONG},
    }
    loads = {"down": own, "aside": load([0, 1, 0], STRONG, known=True)}
    with pytest.raises(InfeasibleError, match="no reading of a candidate depends on down") as error:
        screened(TWO | {"loads": loads, "place.estimate": ["down"], "validate.initial_std": {"down": 0.1}})
    assert error.value.key == "place.estimate"
