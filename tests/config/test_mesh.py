"""What the mesh of a config may say, and what contradicts it."""

from __future__ import annotations

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

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
gauges: {given: {rows: b.mtx, table: gauges.csv}, noise_std: {value: 1.0e-7}}
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


def test_all_that_a_mesh_may_need_beside_its_file_is_accepted(load):
    mesh = load(CONFIG)["mesh"]
    assert mesh["supports"][0]["components"] == [1, 2, 3]
    assert mesh["matrices"]["stiffness"][0] == {"file": "k.mtx", "name": None, "parameter": "E", "at": 2.1e11}
    assert mesh["format"] == "auto"


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("{set: root}", "{set: root, node: 3}", "mesh.supports[0]"),
        ("{set: root}", "{components: [1]}", "mesh.supports[0]"),
        ("[1, 6]", "[1, 7]", "mesh.supports[1].components"),
        ("[1, 6]", "[]", "mesh.supports[1].components"),
        ("type: rigid", "type: stiff", "mesh.ties[0].type"),
        ("poisson_ratio: 0.3", "poisson_ratio: 0.5", "mesh.materials.steel.poisson_ratio"),
        ("materials: {steel", "materials: {lead: {regions: [1], " + LEAD, "mesh.materials"),
        ("materials: {steel", "materials: {lead: {regions: all, " + LEAD, "mesh.materials"),
        ("parameter: E, at", "parameter: Ee, at", "mesh.matrices.stiffness[0].parameter"),
        ("{file: m.mtx}", "{file: m.mtx, parameter: E}", "mesh.matrices.mass[0].parameter"),
        ("{file: m.mtx}", "{file: m.mtx, at: 3.0}", "mesh.matrices.mass[0].at"),
        ("parameter: E, at: 2.1e11", "name: K", "parameters.E"),
        ("property: youngs_modulus, guess", "property: youngs_modulus, region: 1, guess", "parameters.E.region"),
        ("deck_load: FORCE-1", "deck_load: FORCE-1, node: 3", "loads.tip"),
        ("deck_load: FORCE-1", "deck_load: FORCE-1, direction: [0, 0, 1]", "loads.tip.direction"),
        ("deck_load: FORCE-1", "node: 3", "loads.tip.direction"),
        ("given: {rows: b.mtx, table: gauges.csv}", "surface: all", "gauges.direction"),
        ("table: gauges.csv}", "table: gauges.csv}, direction: {type: axis, axis: [1, 0, 0]}", "gauges.direction"),
    ],
)
def test_a_contradiction_is_reported_at_its_key(load, old, new, key):
    assert CONFIG.count(old) == 1
    with pytest.raises(ConfigError) as caught:
        load(CONFIG.replace(old, new))
    assert caught.value.key.startswith(key)
    assert not caught.value.others
    assert caught.value.remedy


def test_without_matrices_a_parameter_needs_its_region(load):
    start, end = CONFIG.index("  matrices:"), CONFIG.index("  materials:")
    text = CONFIG[:start] + CONFIG[end:]
    with pytest.raises(ConfigError) as caught:
        load(text)
    assert {caught.value.key, *(error.key for error in caught.value.others)} == {"parameters.E.region", "gauges.given"}


def sections(text: str) -> str:
    """The config without matrices, with these sections."""
    start, end = CONFIG.index("  matrices:"), CONFIG.index("  materials:")
    plain = CONFIG[:start] + f"  sections: {text}\n" + CONFIG[end:]
    return plain.replace("youngs_modulus, guess", "youngs_modulus, region: 1, guess").replace(
        "given: {rows: b.mtx, table: gauges.csv}", "direction: {type: axis, axis: [1, 0, 0]}"
    )


BEAM = "regions: [spar], area: 1.0e-4, second_moments: [2.0e-9, 1.0e-9], torsion: 1.0e-9, direction: [0, 0, 1]"


@pytest.mark.parametrize(
    "text",
    [
        "{skin: {regions: [wing, 3], thickness: 0.002, offset: -0.001}}",
        f"{{spar: {{{BEAM}, size: [0.01, 0.02]}}, rod: {{regions: [stay], area: 1.0e-4, torsion: 0}}}}",
        "{spar: {" + BEAM.replace("1.0e-9]", "1.0e-9, -1.0e-9]") + "}}",
    ],
)
def test_sections_of_shells_beams_and_rods_are_accepted(load, text):
    assert load(sections(text))["mesh"]["sections"]


@pytest.mark.parametrize(
    ("text", "key", "what"),
    [
        ("regions: all", "", "none of 'thickness', 'area' is given"),
        ("regions: all, thickness: ", "", "none of 'thickness', 'area' is given"),
        ("regions: all, thickness: 0.002, area: 1.0e-4", "", "are both given"),
        ("regions: all, thickness: 0", ".thickness", "has to be above 0"),
        ("regions: all, thickness: 0.002, torsion: 1.0", ".torsion", "is of beams"),
        ("regions: all, thickness: 0.002, direction: [0, 0, 1]", ".direction", "is of beams"),
        (f"{BEAM}, offset: 0.1", ".offset", "is of shells"),
        ("regions: all, area: 1.0e-4, direction: [0, 0, 1]", ".direction", "this is a rod"),
        (BEAM.replace("torsion: 1.0e-9, ", ""), ".torsion", "missing"),
        (BEAM.replace(", direction: [0, 0, 1]", ""), ".direction", "missing"),
        (BEAM.replace("[0, 0, 1]", "[0, 0, 0]"), ".direction", "length zero"),
        (BEAM.replace("1.0e-9]", "1.0e-9, 2.0e-9]"), ".second_moments", "too large"),
    ],
)
def test_a_section_is_that_of_a_shell_or_of_a_beam(load, text, key, what):
    with pytest.raises(ConfigError, match=what) as caught:
        load(sections(f"{{own: {{{text}}}}}"))
    assert caught.value.key == f"mesh.sections.own{key}"
    assert not caught.value.others
    assert caught.value.remedy


def test_a_choice_of_mass_beside_matrices_is_refused(load):
    with pytest.raises(ConfigError, match=r"the mass is that of mesh\.matrices") as caught:
        load(CONFIG.replace("  matrices:", "  mass: lumped\n  matrices:"))
    assert caught.value.key == "mesh.mass"


def test_sections_beside_matrices_are_refused(load):
    with pytest.raises(ConfigError, match=r"stiffness and mass are those of mesh\.matrices") as caught:
        load(CONFIG.replace("  matrices:", "  sections: {skin: {regions: all, thickness: 0.002}}\n  matrices:"))
    assert caught.value.key == "mesh.sections"
