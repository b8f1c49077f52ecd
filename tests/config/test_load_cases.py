"""What a config may say of load cases."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

EXAMPLE = Path(__file__).parents[2] / "configs" / "cantilever-input.yaml"
LOADS = (
    "loads.side={node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 30, amplitude: 100}}",
    "place.estimate=[tip, side]",
    "validate.initial_std={tip: 0.1, side: 0.1}",
)


def loaded(cases, *more):
    return load_config(EXAMPLE, [*LOADS, *more, f"place.load_cases={cases}"]).model.place.load_cases


def test_a_case_without_overrides_is_the_loads_as_stated():
    found = loaded("{plain: {}, idle: {weight: 2, loads: {side: none}, duration: 0.5, settle: none}}")
    assert found["plain"].weight == 1
    assert found["plain"].loads == {}
    assert found["idle"].loads == {"side": "none"}
    assert loaded("null") is None


@pytest.mark.parametrize(
    ("cases", "key", "what", "remedy"),
    [
        ("{}", "place.load_cases", "at least 1", ""),
        ("{a: {weight: 0}}", "place.load_cases.a.weight", "0 has to be above 0", ""),
        ("{a: {weight: -1}}", "place.load_cases.a.weight", "above 0", ""),
        ("{a: {loads: {sid: none}}}", "place.load_cases.a.loads.sid", "no load 'sid'", "did you mean side?"),
        ("{a: {loads: {side: nono}}}", "place.load_cases.a.loads.side", "'nono'", "did you mean none?"),
        ("{a: {loads: {side: none, tip: none}}, b: {}}", "place.load_cases.a.loads", "no load acts", "remove the case"),
        ("{a: {loads: {side: none}}}", "place.load_cases", "'side' is silent in every case", "let side act"),
        ("{a: {wieght: 1}}", "place.load_cases.a.wieght", "unknown key", "did you mean weight?"),
        ("{a: {loads: {tip: {signal: {type: sin, frequency: 1, amplitude: 1}}}}}", "place.load_cases.a.loads.tip.signal.type",
         "'sin' is not one of", "did you mean sine?"),
        ("{a: {loads: {tip: {signal: {type: sine, frequency: 900, amplitude: 1}}}}}", "place.load_cases.a.time_step",
         "of load 'tip' (900 Hz)", "take at most"),
        ("{a: {loads: {tip: {signal: {type: sine, frequency: 9, amplitude: 1}, frequency: 900}}}}",
         "place.load_cases.a.loads.tip.frequency", "900 Hz", "take at most"),
        ("{a: {loads: {tip: {signal: {type: csv, file: f.csv, time_column: t, value_column: F}}}}}",
         "place.load_cases.a.loads.tip.frequency", "needs a typical frequency", "[Hz]"),
        ("{a: {loads: {tip: {signal: {type: multisine, lowest: 9, highest: 3, count: 2, amplitude: 1}}}}}",
         "place.load_cases.a.loads.tip.signal.lowest", "above the highest", "swap them"),
        ("{a: {loads: {side: none, tip: {signal: {type: sine, frequency: 1, amplitude: 1}}}, time_step: 0.01}, b: {}}",
         "place.load_cases.a.loads.side", "30 Hz, of which the time step of this case takes 3.33 steps", "a shorter step"),
        ("{a: {duration: 1.0001}}", "place.load_cases.a.time_step", "does not divide", "take"),
        ("{a: {settle: 1.0e+9}}", "place.load_cases.a.settle", "steps", "take at most"),
        ("{'a b': {}}", "place.load_cases.a b", "", ""),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_key_and_the_remedy(cases, key, what, remedy):
    with pytest.raises(ConfigError) as caught:
        loaded(cases)
    found = [error for error in (caught.value, *caught.value.others) if error.key == key]
    assert found, [(e.key, e.what) for e in (caught.value, *caught.value.others)]
    assert what in found[0].what
    assert found[0].remedy
    assert remedy in found[0].remedy


def test_a_case_in_which_all_that_the_criterion_covers_is_silent_is_refused():
    with pytest.raises(ConfigError, match="side is silent, and the criterion covers nothing else") as caught:
        loaded("{a: {loads: {side: none}}, b: {}}", "place.metric_over=[side]")
    assert caught.value.key == "place.load_cases.a.loads"


def test_the_step_of_a_case_resolves_the_process_noise_that_a_load_has_as_stated():
    slow = "{type: sine, frequency: 1, amplitude: 1}"
    cases = f"{{a: {{loads: {{side: {{signal: {slow}}}, tip: {{signal: {slow}}}}}, time_step: 0.01}}}}"
    assert loaded(cases)["a"].time_step == 0.01
    with pytest.raises(ConfigError, match="40 Hz, of which the time step of this case") as caught:
        loaded(cases, "loads.side.process_noise.frequency=40")
    assert caught.value.key == "loads.side.process_noise.frequency"
