"""Load cases: several trainings in one placement, against all layouts of a small pool by SciPy's Riccati solver."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import yaml
from scipy.linalg import solve_continuous_are

from strainsight import api
from strainsight.experiment.structure.problem import problem_of
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.training import runs_of
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training

from ..edges.beam import PLACEMENT_CONFIG, TIP, bricks, config_of, finished
from ..shared import slowly

pytestmark = pytest.mark.usefixtures("no_hot_spots")

def sine(frequency, amplitude):
    return {"type": "sine", "frequency": frequency, "amplitude": amplitude}


LOADS = {
    "down": {"node": TIP, "direction": [0, 0, 1], "known": False, "signal": sine(20.0, 1000.0)},
    "aside": {"node": TIP, "direction": [0, 1, 0], "known": False, "signal": sine(30.0, 400.0)},
}
TWO = {
    "loads": LOADS,
    "parameters": {},
    "place.estimate": ["down", "aside"],
    "place.installation": "ignore",
    "gauges.clearance": "none",
    "screen.keep": 9,
    "screen.minimum_spacing": 0.06,
    "validate.truth.parameters": {},
    "validate.initial_std": {"down": 0.1, "aside": 0.1},
}
DOWN, ASIDE = {"loads": {"aside": "none"}}, {"loads": {"down": "none"}}
SILENT = {"down": ("aside",), "aside": ("down",)}
BRAKING = {"loads": {"down": {"signal": sine(10.0, 5000.0)}, "aside": {"signal": sine(12.0, 50.0)}}}


class Beam:
    """A beam with two unknown loads at its tip, reduced once."""

    def __init__(self, folder, changes):
        self.folder, self.changes = folder, changes
        (folder / "beam.bdf").write_text(bricks((8, 2, 2)), encoding="utf-8")
        case = self.case()
        self.mesh = api.mesh(case)
        self.reduced = api.reduce(case, self.mesh)

    def case(self, cases=None, **place):
        stated = {f"place.{key}": value for key, value in place.items()} | {"place.load_cases": cases}
        path = self.folder / "edge.yaml"
        path.write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, self.changes | stated)), encoding="utf-8")
        return api.load(path)

    def trained(self, case):
        training = api.train(case, self.mesh, self.reduced)
        return training, api.screen(case, self.mesh, self.reduced, training)

    def placed(self, cases=None, **place):
        """The layout for these cases."""
        case = self.case(cases, **place)
        training, screened = self.trained(case)
        return api.place(case, self.mesh, self.reduced, training, screened)


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return Beam(tmp_path_factory.mktemp("two"), TWO)


@pytest.fixture(scope="module")
def with_modulus(tmp_path_factory):
    more = {"parameters": PLACEMENT_CONFIG["parameters"], "place.estimate": ["down", "aside", "E"], "screen.keep": 8}
    start = {"validate.initial_std": {"down": 0.1, "aside": 0.1, "E": 0.1}, "place.keep": 3}
    return Beam(tmp_path_factory.mktemp("modulus"), TWO | more | start)


def covariance(pool, gauges):
    """P (n*, n*) of x* by SciPy, NaN where it gives up: the unknowns are lost, or nearly."""
    s, size = pool.scenario, len(pool.P)
    H = s.H[gauges].reshape(-1, size) / np.sqrt(s.r[gauges].ravel())[:, None]
    lost = np.full((size, size), np.nan)
    try:
        P = solve_continuous_are(s.F.T, H.T, s.Q, np.eye(len(H)))
    except (np.linalg.LinAlgError, ValueError):
        return lost
    left = s.F @ P + P @ s.F.T - P @ H.T @ H @ P + s.Q
    good = np.abs(left).max() < 1e-7 * np.abs(s.F @ P).max() and np.linalg.eigvalsh(P).min() > 0
    return P * np.outer(pool.scale, pool.scale) if good else lost


def by_case(found, silent, criterion="trace"):
    """gauges → case → metric of every instant, of all layouts of the size, from the formulae of the documentation."""
    task = found.task
    names, at, of = list(task.cases.names), task.unknowns.at, task.cases.of.tolist()
    count = len(task.pools[0].rows)
    acts = {c: np.array([n not in silent.get(c, ()) for n in task.unknowns.names]) for c in names}

    def blocks(gauges):
        return [
            (names[i], covariance(pool, list(gauges))[np.ix_(at, at)]) for pool, i in zip(task.pools, of, strict=True)
        ]

    whole = blocks(range(count))
    unit = {c: np.mean([np.diag(P) for case, P in whole if case == c], axis=0) for c in names}
    costs = {}
    for gauges in combinations(range(count), len(found.final)):
        own = {c: [] for c in names}
        for c, P in blocks(gauges):
            if criterion == "trace":
                own[c].append(float(np.sum((np.diag(P) / unit[c])[acts[c]])))
            else:
                own[c].append(float(np.linalg.det(P[np.ix_(acts[c], acts[c])]) ** (1 / acts[c].sum())))
        if np.isfinite(np.concatenate(list(own.values()))).all():
            costs[gauges] = own
    return costs


def together(costs, weights, aggregate):
    """gauges → Σ w c/Σ w of the means over instants, or max w c/max w of the largest."""
    if aggregate == "mean":
        total = sum(weights.values())
        return {g: sum(weights[c] * np.mean(f) for c, f in own.items()) / total for g, own in costs.items()}
    heaviest = max(weights.values())
    return {g: max(weights[c] * max(f) for c, f in own.items()) / heaviest for g, own in costs.items()}


@pytest.mark.parametrize(
    ("which", "criterion", "aggregate"),
    [
        ("beam", "trace", "mean"),
        ("with_modulus", "trace", "worst"),
        *slowly(
            ("beam", "log_determinant", "worst"),
            ("beam", "trace", "worst"),
            ("beam", "log_determinant", "mean"),
            ("with_modulus", "trace", "mean"),
        ),
    ],
)
def test_layout_and_bound_agree_with_all_layouts_of_the_pool(request, which, criterion, aggregate):
    weights = {"braking": 1.0, "down": 3.0, "aside": 0.5}
    cases = {"braking": BRAKING, "down": DOWN | {"weight": 3.0}, "aside": ASIDE | {"weight": 0.5, "duration": 0.2}}
    keep = 4 if which == "with_modulus" else 3
    found = request.getfixturevalue(which).placed(cases, keep=keep, prove=60, aggregate=aggregate, criterion=criterion)
    costs = together(by_case(found, SILENT, criterion), weights, aggregate)
    assert len(costs) > 50
    best = min(costs.values())
    assert max(costs.values()) > 1.05 * best
    assert found.layout.proof.proven
    assert found.layout.cost == pytest.approx(costs[tuple(sorted(found.final.tolist()))], rel=1e-6)
    assert found.layout.cost == pytest.approx(best, rel=1e-6)
    bound = found.layout.certificate
    assert bound.lower_bound <= best * (1 + 1e-9)
    assert bound.gap < 1.001e-6  # by the proof, up to a tie
    # the elimination begins with every unknown at 1 in every case in which it acts
    if criterion == "trace" and aggregate == "mean":
        count = {"braking": 2, "down": 1, "aside": 1}
        more = len(found.task.unknowns.names) - 2
        whole = sum(weights[c] * (n + more) for c, n in count.items()) / sum(weights.values())
        assert found.elimination.cost[0] == pytest.approx(whole, rel=1e-9)


def test_without_a_proof_the_relaxation_bounds_all_layouts(beam):
    found = beam.placed({"down": DOWN | {"weight": 3.0}, "aside": ASIDE | {"weight": 0.5}}, keep=3)
    best = min(together(by_case(found, SILENT), {"down": 3.0, "aside": 0.5}, "mean").values())
    bound = found.layout.certificate.lower_bound
    assert bound <= best * (1 + 1e-9)
    assert bound > 0.7 * best
    assert found.layout.cost == pytest.approx(best, rel=1e-6)


def test_two_cases_that_are_equally_give_what_one_gives_whatever_their_weights(with_modulus):
    one = with_modulus.placed(None, keep=3, aggregate="worst")
    two = with_modulus.placed({"a": {"weight": 0.3}, "b": {"weight": 0.7}}, keep=3, aggregate="worst")
    np.testing.assert_array_equal(two.gauges, one.gauges)
    assert two.layout.cost == pytest.approx(one.layout.cost, rel=1e-10)
    np.testing.assert_allclose(two.elimination.cost, one.elimination.cost, rtol=1e-10)
    assert two.layout.certificate.lower_bound == pytest.approx(one.layout.certificate.lower_bound, rel=1e-3)
    for name, std in one.expected.std.items():
        np.testing.assert_allclose(two.by_case.std[name], [std, std], rtol=1e-12)


def test_a_silent_load_keeps_the_process_noise_that_it_has_as_stated_and_others_have_that_of_the_case(beam):
    """κω of the random walk with κ = 1/2π is the frequency in hertz, in units of the amplitude."""
    quick = {"signal": sine(10.0, 5000.0), "frequency": 40.0, "amplitude": 250.0}
    cases = {"silent": DOWN, "other": {"loads": {"down": quick}}}
    case = beam.case(cases)
    training, screened = beam.trained(case)
    structure = Structure(case.config, case.files, beam.mesh, beam.reduced, training)
    found = {
        run.name: problem_of(structure, screened, run)
        for run in runs_of(case.config, beam.reduced.model.inputs, case.files)
    }
    walks = {name: np.diag(own.Q)[-2:] for name, own in found.items()}
    np.testing.assert_allclose(walks["silent"], [20.0, 30.0], rtol=1e-12)
    np.testing.assert_allclose(walks["other"], [40.0, 30.0], rtol=1e-12)
    assert found["silent"].unknowns.amplitude == {"down": 1000.0, "aside": 400.0}
    assert found["other"].unknowns.amplitude == {"down": 250.0, "aside": 400.0}
    loads = {name: np.abs(own.load).max(axis=0) for name, own in training.cases.items()}
    at = [beam.reduced.model.inputs.index(name) for name in ("down", "aside")]
    np.testing.assert_allclose(loads["silent"][at], [1000.0, 0.0], rtol=0.01)
    np.testing.assert_allclose(loads["other"][at], [5000.0, 400.0], rtol=0.01)


def test_noise_is_that_of_a_sample_at_the_training_step_whatever_the_step_of_a_case(beam):
    found = beam.placed({"a": {}, "b": {"time_step": 0.0005}}, keep=3)
    one, other = (pool.scenario.r for pool in found.task.pools)
    np.testing.assert_allclose(one, other, rtol=1e-3)  # the motion of half the step adds a little to the model error
    a, b = found.by_case.std["down"]
    assert a == pytest.approx(b, rel=0.05)


def test_screening_takes_the_strongest_and_the_largest_over_the_cases(beam):
    """Readings are linear in the loads: five times the load reads five times as much."""
    plain, before = beam.trained(beam.case())
    strong = {"loads": {"down": {"signal": sine(20.0, 5000.0)}, "aside": {"signal": sine(30.0, 2000.0)}}}
    training, screened = beam.trained(beam.case({"weak": {}, "strong": strong}))
    np.testing.assert_allclose(training.rms, 5 * np.sqrt(np.mean(plain.reading() ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(training.peak, 5 * np.abs(plain.reading()).max(axis=0), rtol=1e-9)
    np.testing.assert_array_equal(training.reading(), plain.reading())  # of the loads as stated, for what comes after
    np.testing.assert_allclose(screened.noise_std, 5 * before.noise_std, rtol=1e-9)


def test_a_case_takes_a_recorded_load(beam):
    time = np.linspace(0, 0.2, 201)
    lines = ["t,F", *(f"{t:.6f},{3000 * t / 0.2:.6f}" for t in time)]
    (beam.folder / "ramp.csv").write_text("\n".join(lines), encoding="utf-8")
    ramp = {"type": "csv", "file": "ramp.csv", "time_column": "t", "value_column": "F"}
    case = beam.case({"ramp": {"loads": {"down": {"signal": ramp, "frequency": 5.0}}}})
    assert "place.load_cases.ramp.loads.down.signal.file" in case.files
    training, _ = beam.trained(case)
    at = beam.reduced.model.inputs.index("down")
    ramp = training.cases["ramp"]
    np.testing.assert_allclose(ramp.load[:, at], 15000 * ramp.time, rtol=1e-6, atol=1e-6)


def test_a_run_reports_what_is_expected_in_every_case_and_where_it_is_worst(tmp_path):
    cases = {"steering": BRAKING, "down": DOWN | {"weight": 2.0}}
    short = {"place.load_cases": cases, "place.keep": 3, "place.certificate": False}
    own = finished(tmp_path, "place", bricks((6, 2, 2)), TWO | short)
    placed = read(Placed, own["place"])
    own_cases = placed.by_case
    assert own_cases.name == ("down", "steering")
    training, inputs = read(Training, own["train"]), read(Reduced, own["rom"]).model.inputs
    np.testing.assert_array_equal(own_cases.weight, [2.0, 1.0])
    assert own_cases.acts["aside"].tolist() == [False, True]
    for name in ("down", "aside"):
        worst = own_cases.name.index(own_cases.worst[name])
        assert own_cases.std[name][worst] == own_cases.std[name][own_cases.acts[name]].max()
        expected = own_cases.std[name][worst] * own_cases.scale[name][worst]
        assert placed.expected_std[name] == pytest.approx(expected, rel=1e-12)
        for i in np.flatnonzero(own_cases.acts[name]):
            load = training.cases[own_cases.name[i]].load[:, inputs.index(name)]
            rms = np.sqrt(np.mean(load[int(np.ceil(0.1 * len(load))) :] ** 2))
            assert own_cases.scale[name][i] == pytest.approx(rms, rel=0.05)
    mean = np.average(own_cases.metric, weights=own_cases.weight)
    assert own["place"].summary["trace_final"] == pytest.approx(mean, rel=1e-10)
    assert own["observe"]["/excitation"].astype(str).tolist() == ["down", "steering"]
    condition, numbers = own["observe"]["/condition"], own["observe"].summary
    assert list(numbers.values()) == condition.max(axis=0).tolist()
    assert condition[0].max() != condition.max()  # the worst case is not the first
    assert " in steering" in own["observe"].message
