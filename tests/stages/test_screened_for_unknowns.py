"""Screening by what each unknown does to the readings, over noise and errors of installation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.cases.structure.installation_noise import COHERENCE
from strainsight.errors import ConfigError, InfeasibleError

from ..edges.beam import PLACEMENT_CONFIG, TIP, bricks, config_of

STRONG, WEAK, STEP, DURATION = 1000.0, 1.0, 0.002, 0.2


def load(direction, amplitude, known=False):
    signal = {"type": "sine", "frequency": 10.0, "amplitude": amplitude}
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
    """Changes → case, mesh, reduced model, training and screening of a beam."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.bdf").write_text(bricks((8, 3, 3)), encoding="ascii")

    def of(changes):
        path = folder / "edge.yaml"
        path.write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, PLAIN | changes)), encoding="utf-8")
        case = api.load(path)
        mesh = api.mesh(case)
        reduced = api.reduce(case, mesh)
        training = api.train(case, mesh, reduced)
        return case, mesh, reduced, training, api.screen(case, mesh, reduced, training)

    return of


def best(ratio, count):
    """So many places (count,), the largest of each row in turn; the beam has places that read alike."""
    found, orders = [], [np.argsort(-np.round(own / own.max(), 7), kind="stable").tolist() for own in ratio]
    while len(found) < count:
        for own in orders:
            if len(found) < count:
                found.append(next(i for i in own if i not in found))
    return sorted(found)


def over(training, screened):
    """√(σ² + τ v/h) of every channel."""
    return np.sqrt(screened.noise_std**2 + COHERENCE * DURATION / STEP * screened.installation[0])


def test_a_weak_load_has_its_share_of_the_candidates(screened):
    """Each load alone, by a run of its own without the other. The strongest hardly feel the weak one: they lie in the axis
    of its bending."""
    case, mesh, reduced, training, found = screened(TWO | {"tolerances": "none"})
    alone = []
    for name, other in (("down", "aside"), ("aside", "down")):
        loads = {name: TWO["loads"][name], other: load([1, 0, 0], 1e-12)}
        alone.append(screened(TWO | {"loads": loads, "tolerances": "none"})[3].rms / found.noise_std)
    alone = np.array(alone)
    np.testing.assert_allclose(np.sort(alone[:, found.kept]), np.sort(alone[:, best(alone, 8)]), rtol=1e-6)
    np.testing.assert_allclose(found.snr, np.max(alone, axis=0), rtol=1e-6, atol=1e-6)
    by_strength = screened(TWO | {"screen.by": "strength", "tolerances": "none"})[4]
    assert training.rms[by_strength.kept].min() >= (1 - 1e-6) * np.sort(training.rms)[-8]
    weak = [alone[1][own.kept].max() for own in (found, by_strength)]
    assert weak[0] > 1.5 * weak[1]
    both = [api.place(case, mesh, reduced, training, own).expected.std["aside"] for own in (found, by_strength)]
    assert both[0] < 0.8 * both[1]


def test_a_modulus_under_a_slow_load_is_seen_in_the_readings_themselves(screened):
    """ε = Hq with Kq = f far below the first mode: θ ∂ε/∂θ = −ε."""
    slow = {"loads": {"tip": load([0, 0, 1], STRONG, known=True)}, "tolerances": "none"}
    slow["loads"]["tip"]["signal"]["frequency"] = 1.0
    *_, training, found = screened(slow)
    np.testing.assert_allclose(found.snr, training.rms / found.noise_std, rtol=5e-4, atol=1e-6)
    assert not found.installation.any()


def test_places_of_small_errors_take_turns_with_strong_ones(screened):
    """Of E beside errors of place alone: those that read most over noise, and those over noise and τ v/h, in turn."""
    names = ("angle", "gain", "transverse", "frequency", "load_angle", "load_position", "load_gain")
    exact = dict.fromkeys(names, 0) | {"damping": 1}
    *_, training, found = screened({"tolerances": exact | {"position": 0.005}})
    rms = found.snr * found.noise_std
    ratio = np.array([found.snr, rms / over(training, found)])
    np.testing.assert_allclose(np.sort(ratio[:, found.kept]), np.sort(ratio[:, best(ratio, 8)]), rtol=1e-6)
    assert ratio[1, found.kept].sum() > 1.01 * ratio[1, best(ratio[:1], 8)].sum()
    assert np.all(found.snr >= ratio[1])


def test_a_placement_that_avoids_errors_wants_them_screened(screened):
    case, mesh, reduced, training, found = screened({})
    with pytest.raises(ConfigError, match="screened without their errors") as error:
        api.place(case, mesh, reduced, training, replace(found, installation=None))
    assert "screen them with this config" in str(error.value)


def test_an_unknown_that_does_nothing_in_training_is_refused(screened, tmp_path):
    """Its record is zero all along; beside it a known load acts."""
    still = tmp_path / "still.csv"
    still.write_text("t,F\n0,0\n1,0\n", encoding="utf-8")
    own = load([0, 0, 1], STRONG) | {
        "signal": {"type": "csv", "file": str(still), "time_column": "t", "value_column": "F"},
        "process_noise": {"frequency": 10.0, "amplitude": STRONG},
    }
    loads = {"down": own, "aside": load([0, 1, 0], STRONG, known=True)}
    with pytest.raises(InfeasibleError, match="of down alone every candidate reads 0") as error:
        screened(TWO | {"loads": loads, "place.estimate": ["down"], "validate.initial_std": {"down": 0.1}})
    assert error.value.key == "place.estimate"
