"""A small beam and a suite whose names are attacks: markup, quotes, very long words, other alphabets, reversed text."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

SCRIPT = "<script>alert(1)</script>"
IMAGE = "\"><img src=x onerror=alert(2)>'"
LONG = "Unbreakablename" * 20  # 300 characters without a place to break
GREEK = "Καλώδιο δοκού 梁の先端"
REVERSED = "عارضة \u202efdp.exe\u202c פלדה"
BREAKOUT = "</title></style></script><!-- --><svg onload=alert(3)> & &amp; ${alert(4)} {{5}} \\u003c"
FORMULA = "=1+cmd|'/C calc'!A0"
NAMES = (SCRIPT, IMAGE, LONG, GREEK, REVERSED, BREAKOUT, FORMULA)
IN_A_DECK = (SCRIPT, LONG, GREEK, REVERSED, BREAKOUT, FORMULA, "onfocus='alert(5)' autofocus")
"""Without the double quotes that end a name there."""

SIZE = (1.0, 0.08, 0.05)
"""Of the beam along x, y, z [m]."""
COUNT = (len(IN_A_DECK), 2, 2)
"""Elements along x, y, z: one slab of the beam a name."""


def deck(folder: Path) -> Path:
    """A clamped beam of hex8 in Abaqus' format: its materials, element sets and node sets have the names above.

    The density of its materials is that of a gas, so that a warning names each of them.
    """
    nx, ny, nz = COUNT
    places = itertools.product(range(nx + 1), range(ny + 1), range(nz + 1))
    number = {ijk: at for at, ijk in enumerate(places, start=1)}
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    lines = [f"** {SCRIPT} {REVERSED}", "*HEADING", f" {IMAGE}", "*NODE"]
    for ijk, n in number.items():
        lines.append(f"{n}, " + ", ".join(f"{s * i / c:.9g}" for s, i, c in zip(SIZE, ijk, COUNT, strict=True)))
    elements = itertools.count(1)
    for i, name in enumerate(IN_A_DECK):
        lines.append(f'*ELEMENT, TYPE=C3D8, ELSET="{name}"')
        for j, k in itertools.product(range(ny), range(nz)):
            nodes = [number[i + di, j + dj, k + dk] for di, dj, dk in corners]
            lines.append(f"{next(elements)}, " + ", ".join(map(str, nodes)))
    for name in IN_A_DECK:
        lines += [f'*SOLID SECTION, ELSET="{name}", MATERIAL="{name}"', f'*MATERIAL, NAME="{name}"']
        lines += ["*ELASTIC", "2.1e11, 0.3", "*DENSITY", "0.7"]
    ends = {f"foot {SCRIPT}": lambda ijk: ijk[0] == 0, f"top {REVERSED}": lambda ijk: ijk[2] == nz}
    for name, within in ends.items():
        lines += [f'*NSET, NSET="{name}"', *(str(n) for ijk, n in number.items() if within(ijk))]
    lines += ["*BOUNDARY", f'"foot {SCRIPT}", 1, 3', ""]
    path = folder / "beam <img src=x onerror=alert(7)> '梁'.inp"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def config(folder: Path) -> Path:
    """A quick placement on that beam that calls everything by the names of the deck."""
    nx, ny, nz = COUNT
    tip = (nx + 1) * (ny + 1) * (nz + 1)
    path = folder / "beam.yaml"
    path.write_text(
        f"""# {SCRIPT} {IMAGE} {REVERSED}
kind: placement
name: beam-hostile
seed: 1
mesh:
  file: {quoted(deck(folder).name)}
  mass_unit: kg
parameters:
  {"E" * 64}:
    {{property: youngs_modulus, process_noise_scale: 0.05, guess: 1.9e+11, range: [1.6e+11, 2.4e+11],
     region: [{", ".join(map(quoted, IN_A_DECK))}]}}
loads:
  {"F" * 64}: {{node: {tip}, direction: [0, 0, 1], known: false,
    signal: {{type: sine, frequency: 20.0, amplitude: 100.0}}}}
damping: {{type: modal, ratio: 0.01}}
rom: {{modes: 4, parameter_samples: 1, tolerance: 1.0e-6}}
train: {{duration: 0.2, time_step: 1.0e-3}}
gauges:
  surface: {quoted(f"top {REVERSED}")}
  direction: {{type: axis, axis: [1, 0, 0], angles: [0]}}
  noise_std: {{relative_to_strongest: 0.01}}
screen: {{keep: 10, minimum_spacing: 0.01}}
place: {{estimate: [{"F" * 64}, {"E" * 64}], keep: 3, instants: 3}}
validate:
  truth: {{model: modes, modes: 6, parameters: {{{"E" * 64}: 2.1e+11}}}}
  time_step: 1.0e-3
  duration: 0.2
  initial_std: {{{"E" * 64}: 0.1, {"F" * 64}: 0.5}}
  random_sets: 2
  repeats: 2
""",
        encoding="utf-8",
    )
    return path


def suite(folder: Path, config: Path) -> Path:
    runs = [
        {"config": config.name, "name": "beam-hostile", "label": SCRIPT, "note": IMAGE},
        {"config": config.name, "name": "beam-long", "label": LONG, "note": BREAKOUT, "set": {"place.keep": 4}},
        {"config": config.name, "name": "beam-words", "label": REVERSED, "note": GREEK, "until": "observe"},
        {"config": config.name, "name": "beam-formula", "label": FORMULA, "note": LONG, "until": "place"},
    ]
    path = folder / "suite.yaml"
    content = {"kind": "suite", "name": "hostile-suite", "title": f"{SCRIPT} {IMAGE} {REVERSED}", "runs": runs}
    path.write_text(json.dumps(content, ensure_ascii=False, indent=2), encoding="utf-8")
    return path
