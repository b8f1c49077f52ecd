"""Meshes, load cases and types of gauges in configs."""

from __future__ import annotations

import copy
import math
import re
from pathlib import Path

import pytest
import yaml

from strainsight.config.gauge_types import CATALOGUE, fitting_type, gauge_type, type_gain
from strainsight.config.load import load_config
from strainsight.errors import ConfigError

from ..edges.beam import PLACEMENT_CONFIG
from ..refusals import expect_refusal

CONFIG = """\
kind: placement
name: own
mesh:
  file: a.vtu
  matrices:
    numbering: rows.csv
    stiffness: [{file: k.mtx, parameter: E, at: 2.1e11}]
    mass: [{file: m.mtx}]
  materials: {steel: {regions: [1, flange], youngs_modulus: 2.1e11, poisson_ratio: 0.3, density: 7850}}
  supports: [{set: root}, {node: 7, components: [1, 6]}]
  ties: [{type: rigid, reference: 900, at: [0, 0, 1], set: top}]
parameters: {E: {property: youngs_modulus, guess: 2.0e11, range: [1.0e11, 3.0e11]}}
loads:
  tip: {deck_load: FORCE-1, known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0}}
damping: {type: modal, ratio: 0.01}
train: {duration: 1.0, time_step: 1.0e-3}
gauges: {strain_operator: {rows: b.mtx, table: gauges.csv}, noise_std: {value: 1.0e-7}}
place: {estimate: [E], keep: 1}
validate: {time_step: 1.0e-3, duration: 1.0, initial_std: {E: 0.1}}
"""
LEAD = "youngs_modulus: 1.0e10, poisson_ratio: 0.4, density: 1.0e4}, steel"


@pytest.fixture
def load(tmp_path):
    def from_text(text: str):
        (tmp_path / "own.yaml").write_text(text)
        return load_config(tmp_path / "own.yaml").data

    return from_text


def sections(text: str) -> str:
    start, end = CONFIG.index("  matrices:"), CONFIG.index("  materials:")
    plain = CONFIG[:start] + f"  sections: {text}\n" + CONFIG[end:]
    return plain.replace("youngs_modulus, guess", "youngs_modulus, region: 1, guess").replace(
        "strain_operator: {rows: b.mtx, table: gauges.csv}", "direction: {type: axis, axis: [1, 0, 0]}"
    )


BEAM = "regions: [spar], area: 1.0e-4, second_moments: [2.0e-9, 1.0e-9], torsion: 1.0e-9, direction: [0, 0, 1]"


def test_all_optional_mesh_keys_are_accepted(load):
    mesh = load(CONFIG)["mesh"]
    assert mesh["supports"][0]["components"] == [1, 2, 3]
    assert mesh["matrices"]["stiffness"][0] == {"file": "k.mtx", "name": None, "parameter": "E", "at": 2.1e11}
    assert mesh["format"] == "auto"
    for text in (
        "{skin: {regions: [wing, 3], thickness: 0.002, offset: -0.001}}",
        f"{{spar: {{{BEAM}, size: [0.01, 0.02]}}, rod: {{regions: [stay], area: 1.0e-4, torsion: 0}}}}",
        "{spar: {" + BEAM.replace("1.0e-9]", "1.0e-9, -1.0e-9]") + "}}",
    ):
        assert load(sections(text))["mesh"]["sections"]


CHANGES = [
    ("{set: root}", "{set: root, node: 3}", "mesh.supports[0]"),
    ("[1, 6]", "[1, 7]", "mesh.supports[1].components"),
    ("  matrices:", "  mass: lumped\n  matrices:", "mesh.mass"),
    ("poisson_ratio: 0.3", "poisson_ratio: 0.5", "mesh.materials.steel.poisson_ratio"),
    ("materials: {steel", "materials: {lead: {regions: [1], " + LEAD, "mesh.materials"),
    ("parameter: E, at", "parameter: Ee, at", "mesh.matrices.stiffness[0].parameter"),
    ("{file: m.mtx}", "{file: m.mtx, parameter: E}", "mesh.matrices.mass[0].parameter"),
    ("{file: m.mtx}", "{file: m.mtx, at: 3.0}", "mesh.matrices.mass[0].at"),
    ("property: youngs_modulus, guess", "property: youngs_modulus, region: 1, guess", "parameters.E.region"),
    ("deck_load: FORCE-1", "deck_load: FORCE-1, node: 3", "loads.tip"),
    ("deck_load: FORCE-1", "deck_load: FORCE-1, direction: [0, 0, 1]", "loads.tip.direction"),
    ("strain_operator: {rows: b.mtx, table: gauges.csv}", "surface: all", "gauges.direction"),
    ("table: gauges.csv}", "table: gauges.csv}, direction: {type: axis, axis: [1, 0, 0]}", "gauges.direction"),
]
SECTIONS = [
    ("regions: all", "", "none of 'thickness', 'area' is set"),
    ("regions: all, thickness: 0.002, area: 1.0e-4", "", "cannot be combined"),
    ("regions: all, thickness: 0", ".thickness", "has to be above 0"),
    ("regions: all, thickness: 0.002, direction: [0, 0, 1]", ".direction", "applies to beams only"),
    ("regions: all, area: 1.0e-4, direction: [0, 0, 1]", ".direction", "and is a rod"),
    (BEAM.replace("torsion: 1.0e-9, ", ""), ".torsion", "missing"),
    (BEAM.replace("[0, 0, 1]", "[0, 0, 0]"), ".direction", "length zero"),
    (BEAM.replace("1.0e-9]", "1.0e-9, 2.0e-9]"), ".second_moments", "too large"),
]


@pytest.mark.parametrize(
    ("text", "key", "what"),
    [
        *((CONFIG.replace(old, new), key, ".") for old, new, key in CHANGES),
        *((sections(f"{{own: {{{text}}}}}"), f"mesh.sections.own{key}", what) for text, key, what in SECTIONS),
    ],
)
def test_inconsistency_is_reported_at_its_key(load, text, key, what):
    assert text != CONFIG
    with expect_refusal(ConfigError, what, remedy="") as caught:
        load(text)
    assert caught.value.key == key if what != "." else caught.value.key.startswith(key)
    assert not caught.value.others


def test_without_matrices_a_parameter_needs_its_region(load):
    start, end = CONFIG.index("  matrices:"), CONFIG.index("  materials:")
    with pytest.raises(ConfigError) as caught:
        load(CONFIG[:start] + CONFIG[end:])
    assert {caught.value.key, *(error.key for error in caught.value.others)} == {"parameters.E.region", "gauges.strain_operator"}


# What a config may say of load cases.
EXAMPLE = Path(__file__).parents[2] / "configs" / "cantilever-input.yaml"
LOADS = (
    "loads.side={node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 30, amplitude: 100}}",
    "place.estimate=[tip, side]",
    "validate.initial_std={tip: 0.1, side: 0.1}",
)


def loaded(cases, *more):
    return load_config(EXAMPLE, [*LOADS, *more, f"place.load_cases={cases}"]).model.place.load_cases


def test_load_case_without_overrides_equals_configured_loads():
    found = loaded("{plain: {}, idle: {weight: 2, loads: {side: none}, duration: 0.5, settle: none}}")
    assert found["plain"].weight == 1
    assert found["plain"].loads == {}
    assert found["idle"].loads == {"side": "none"}
    assert loaded("null") is None


@pytest.mark.parametrize(
    ("cases", "key", "what", "remedy"),
    [
        ("{a: {weight: 0}}", "place.load_cases.a.weight", "is 0, but has to be above 0", ""),
        ("{a: {loads: {sid: none}}}", "place.load_cases.a.loads.sid", "no load has the name 'sid'", "did you mean side?"),
        ("{a: {loads: {side: none, tip: none}}, b: {}}", "place.load_cases.a.loads", "no load acts", "remove the load case"),
        ("{a: {loads: {side: none}}}", "place.load_cases", "'side' does not act in any load case", "{side: {signal: …}}`"),
        ("{a: {loads: {tip: {signal: {type: sin, frequency: 1, amplitude: 1}}}}}", "place.load_cases.a.loads.tip.signal.type",
         "'sin' is not one of", "did you mean sine?"),
        ("{a: {loads: {tip: {signal: {type: sine, frequency: 900, amplitude: 1}}}}}", "place.load_cases.a.time_step",
         "of load 'tip' (900 Hz)", "use a time step of at most"),
        ("{a: {loads: {tip: {signal: {type: sine, frequency: 9, amplitude: 1}, frequency: 900}}}}",
         "place.load_cases.a.loads.tip.frequency", "900 Hz", "use at most"),
        ("{a: {loads: {tip: {signal: {type: csv, file: f.csv, time_column: t, value_column: F}}}}}",
         "place.load_cases.a.loads.tip.frequency", "needs a typical frequency", "[Hz]"),
        ("{a: {loads: {tip: {signal: {type: multisine, lowest: 9, highest: 3, count: 2, amplitude: 1}}}}}",
         "place.load_cases.a.loads.tip.signal.lowest", "above the highest", "exchange the values of `lowest`"),
        ("{a: {loads: {side: none, tip: {signal: {type: sine, frequency: 1, amplitude: 1}}}, time_step: 0.01}, b: {}}",
         "place.load_cases.a.loads.side", "30 Hz is 3.33 times the time step place.load_cases.a.time_step", "or reduce place"),
        ("{a: {duration: 1.0001}}", "place.load_cases.a.time_step", "does not divide", "use"),
    ],
)  # fmt: skip
def test_invalid_load_case_is_refused_with_key_and_remedy(cases, key, what, remedy):
    with pytest.raises(ConfigError) as caught:
        loaded(cases)
    found = [error for error in (caught.value, *caught.value.others) if error.key == key]
    assert found, [(e.key, e.what) for e in (caught.value, *caught.value.others)]
    assert what in found[0].what
    assert found[0].remedy
    assert remedy in found[0].remedy


def test_time_step_of_case_resolves_process_noise():
    slow = "{type: sine, frequency: 1, amplitude: 1}"
    cases = f"{{a: {{loads: {{side: {{signal: {slow}}}, tip: {{signal: {slow}}}}}, time_step: 0.01}}}}"
    assert loaded(cases)["a"].time_step == 0.01
    words = r"40 Hz is 2\.5 times the time step place\.load_cases\.a\.time_step"
    with expect_refusal(ConfigError, words, key="loads.side.process_noise.frequency"):
        loaded(cases, "loads.side.process_noise.frequency=40")


# What a config says by the type of its gauges: defaults, which every key of its own overrides.
OWN = {"grid_length": 0.002, "grid_width": 0.002, "carrier_length": 0.006, "carrier_width": 0.004, "resistance": 1000.0}


@pytest.fixture
def load_typed(tmp_path):
    data = copy.deepcopy(PLACEMENT_CONFIG)
    data["screen"] = {"keep": 8}
    (tmp_path / "edge.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    return lambda *overrides: load_config(tmp_path / "edge.yaml", overrides).model


def test_gauge_type_sets_grid_spacing_range_and_gain(load_typed):
    """3/350 by its data sheet: a grid of 1/8 inch, a carrier of 0.42 × 0.27 inch, 5 %, 350 Ω, a gauge factor to 0.5 %."""
    config = load_typed("gauges.type=3/350")
    assert config.gauges.grid_length == pytest.approx(0.0254 / 8, rel=0.002)
    assert (config.report.gauge_factor, config.report.resistance) == (2.1, 350.0)
    assert config.screen.minimum_spacing == config.place.minimum_spacing == pytest.approx(0.42 * 0.0254, rel=0.005)
    assert config.gauges.range == 0.05
    assert config.tolerances.gain == pytest.approx(math.hypot(0.005, 1 / 350), abs=1e-6)
    assert (config.tolerances.angle, config.gauges.clearance) == (2.0, None)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("gauges.grid_length", 0.0), ("gauges.range", 1e-3), ("gauges.range", None), ("screen.minimum_spacing", 0.0),
        ("place.minimum_spacing", 0.05), ("tolerances.gain", 0.02),
    ],
)
def test_explicit_key_overrides_gauge_type(load_typed, key, value):
    config = load_typed("gauges.type=3/350", f"{key}={'null' if value is None else value}")
    section, name = key.split(".")
    assert getattr(getattr(config, section), name) == value
    others = {"gauges.grid_length", "screen.minimum_spacing", "tolerances.gain"} - {key}
    typed = load_typed("gauges.type=3/350")
    for other in others:
        section, name = other.split(".")
        assert getattr(getattr(config, section), name) == getattr(getattr(typed, section), name)


def test_tolerances_of_none_stay_none_and_accelerometers_keep_their_gain(load_typed):
    assert load_typed("gauges.type=3/120", "tolerances=none").tolerances == "none"
    sensor = "{quantity: acceleration, noise_std: {value: 0.01}}"
    assert load_typed("gauges.type=3/120", f"motion_sensors={{a: {sensor}}}").tolerances.gain == 0.01
    assert load_typed("gauges.type=3/120").tolerances.gain == pytest.approx(math.hypot(0.005, 1 / 120), abs=1e-6)


def test_user_defined_gauge_type_may_replace_catalogue_type(load_typed):
    for name in ("mine", "3/350"):
        config = load_typed(f"gauges.type={name}", f"gauges.types={{{name}: {OWN}}}".replace("'", ""))
        assert (config.gauges.grid_length, config.screen.minimum_spacing) == (0.002, 0.006)
        assert config.tolerances.gain == pytest.approx(math.hypot(0.01, 1 / 1000), abs=1e-6)
        assert gauge_type(config.gauges).bend_radius == 0


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["gauges.type=3/530"], r"gauges\.type: unknown gauge type '3/530' +did you mean 3/350"),
        (["gauges.type=3/350-rosette"], r"gauges\.type: gauge type 3/350-rosette has 3 measuring grids, but each gauge"),
        (
            ["gauges.type=3/350", "gauges.rosette=true", "gauges.direction={type: axis, axis: [1, 0, 0], angles: [0, 45, 90]}"],
            r"gauge type 3/350 has 1 measuring grid, but each gauge of the config needs 3 +set gauges.type to 3/350-rosette",
        ),
    ],
)
def test_unknown_or_unsuitable_gauge_type_is_refused_with_remedy(load_typed, overrides, said):
    with pytest.raises(ConfigError) as caught:
        load_typed(*overrides)
    text = "\n".join(str(problem) for problem in (caught.value, *caught.value.others))
    assert re.search(said, text.replace("\n", " ")), text


def test_gauge_catalogue_agrees_with_its_names():
    for name, own in CATALOGUE.items():
        grid, resistance = name.removesuffix("-rosette").split("/")
        assert own.grid_length == pytest.approx(1e-3 * float(grid), rel=0.07)
        assert own.resistance == float(resistance)
        assert own.grid_length < own.carrier_length
        assert own.grid_width < own.carrier_width
        assert own.grids == (3 if name.endswith("rosette") else 1)
        assert 0.02 < own.range < 0.06
        assert 1.9 < own.gauge_factor < 2.2
        assert 0.005 < type_gain(own) < 0.015
        assert own.source


def test_gauge_type_has_carrier_below_third_of_largest_face():
    assert [fitting_type(side) for side in (1.0, 0.0322, 0.032, 0.0238, 0.0236)] == ["3/350"] * 2 + ["1.5/350"] * 2 + [None]
