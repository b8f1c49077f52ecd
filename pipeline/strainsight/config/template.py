"""The commented config that `strainsight init` writes for the user's own deck."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Suggestion:
    """What a deck itself says about its config.

    length_unit, mass_unit: in which its materials make sense; region: id of the largest one, and its Young's modulus [Pa];
    node: id of one that a load may act on; deck_load: name of a load of the deck that may, and force, its resultant [N];
    materials, supports: whether the deck states them; node_set: the name of one.
    """

    length_unit: str = "m"
    mass_unit: str = "kg"
    region: int = 1
    youngs_modulus: float = 2.0e11
    node: int = 2
    deck_load: str | None = None
    force: float = 1.0e4
    materials: bool = True
    supports: bool = True
    node_set: str = "root"


TEMPLATE = """\
# Where to bond strain gauges on {deck}.
# Lines marked ← are yours to fill in. `strainsight schema` describes every key; values are SI unless a comment says
# otherwise.
kind: placement
name: {name}    # results go to results/{name}
seed: 1                 # of everything that is drawn at random

mesh:
  file: {file}    # from the folder of this file
  length_unit: {length_unit:<8} # ← unit of the deck: m, mm, cm, in, ft
  mass_unit: {mass_unit:<8}   # ← unit of the deck: kg, t, g, lb, slug, lbf*s2/in (a deck in mm and N has t)
{lacking}
# Material properties that are not known exactly. None: parameters: {{}}
parameters:
  E:
    property: youngs_modulus      # or density
    region: {region:<8}              # ← its id or name, or a list of them
    guess: {guess}              # ← [Pa]; or {{from: NAME}} to take what another run has estimated
    range: [{low}, {high}]   # ← [Pa] the true value lies in here
    process_noise_scale: 0.05     # how fast it may drift in the filter that ranks layouts [1/√s]

# Forces. What is known: false has to stand under place.estimate.
loads:
  tip:
{load}    known: true                   # true: measured by a load cell; false: to be estimated
    signal: {{type: sine, frequency: 20.0, amplitude: {force}}}     # ← [Hz], [N]; other types: sweep, multisine, csv

damping: {{type: modal, ratio: 0.01}}         # ← or {{type: rayleigh, alpha: 0.0, beta: 1.0e-5}}

rom:
  modes: 10                       # well above the highest frequency of the loads
  parameter_samples: 5
  tolerance: 1.0e-8

train:
  duration: 1.0                   # ← [s] a few periods of the slowest load
  time_step: 5.0e-4               # ← [s] 40 steps a period of the fastest load

gauges:
  surface: all                    # all exterior facets, or the name of an element or node set
  direction: {{type: axis, axis: [1, 0, 0], angles: [0]}}   # ← projected on the facet; angles [deg]
  noise_std: {{relative_to_strongest: 0.01}}                # ← 1 % of the strongest; or {{value: 1.0e-7}} [strain]
  # clearance: 0.005              # [m] from edges, supports and loads, or none; default: half the diagonal of the carrier
  exclude:                        # zones without gauges; others: box, cylinder, near_edges, near_set [m]
    - normal_cone: {{axis: [1, 0, 0], angle: 10}}           # an axis says nothing on facets that face along it

screen:
  keep: 100                       # candidates that enter the elimination, or all
  minimum_spacing: 0.0            # [m] between them

place:
  estimate: [E]                   # ← names from above
  keep: 4                         # ← gauges you will bond
  instants: 20                    # instants of the training run to place for
  aggregate: mean                 # over them, or worst
  certificate: true               # say how far from the best layout this one can be

validate:
  truth:
    model: rich                   # reality is simulated with more modes, other damping and misplaced gauges
    parameters: {{E: {truth}}}      # ← [Pa] an assumed true value to be found again
  time_step: 5.0e-4               # [s]
  duration: 1.0                   # [s]
  initial_std: {{E: 0.1}}           # ← how wrong the guess may be: 10 %
  random_sets: 10                 # random gauge sets to compare with
  noise_factors: [0.1, 5.0]       # other noise levels to try
  repeats: 20                     # seeds and starting values

report: {{format: html}}
"""


AT_NODE = """\
    node: {node:<8}                # ← node id (an RBE2 or RBE3 reference node will do), or `set: NAME` of nodes
    direction: [0, 0, 1]          # ← in global coordinates; its length does not matter
"""
OF_DECK = """\
    deck_load: {name:<18} # ← the deck's, at its nodes and in its direction; amplitude: its {force} N
                                  # or `node: {node}`, or `set: NAME` of nodes, and `direction: [0, 0, 1]`
"""
MATERIALS = """\
  materials:            # the file states none
    steel: {regions: all, youngs_modulus: 2.0e11, poisson_ratio: 0.3, density: 7850}   # ← [Pa], [-], [kg/m³]
"""
SUPPORTS = """\
  supports:             # the file states none
    - {{set: {set}, components: [1, 2, 3]}}   # ← or node: ID; 1-3 translations
"""


def template(deck: str, found: Suggestion | None = None) -> str:
    """A config for the deck at `deck` (path from the config's folder); it validates as it stands."""
    found = found or Suggestion()
    stem = re.split(r"[/\\\\]", deck)[-1].removesuffix(".gz").rsplit(".", 1)[0]
    name = re.sub(r"[^A-Za-z0-9]+", "-", stem).strip("-").lower()[:90]
    if not name[:1].isalpha() or name in ("null", "true", "false"):  # YAML would not read these as text
        name = f"run-{name}".rstrip("-")
    E = found.youngs_modulus
    lacking = MATERIALS * (not found.materials)
    if not found.supports:
        lacking += SUPPORTS.format(set=_quoted(found.node_set))
    force = _plain(found.force)
    of_deck = found.deck_load and OF_DECK.format(name=_quoted(found.deck_load), force=force, node=found.node)
    return TEMPLATE.format(
        deck=json.dumps(deck, ensure_ascii=False)[1:-1],
        name=name,
        file=_quoted(deck),
        length_unit=found.length_unit,
        mass_unit=found.mass_unit,
        lacking=lacking,
        region=found.region,
        load=AT_NODE.format(node=found.node) if of_deck is None else of_deck,
        force=force,
        guess=_number(E),
        low=_number(0.8 * E),
        high=_number(1.2 * E),
        truth=_number(1.05 * E),
    )


def _quoted(text: str) -> str:
    """Text as YAML: a JSON string is a YAML string, whatever is in it."""
    plain = re.fullmatch(r"[A-Za-z0-9_./-]*[A-Za-z_/][A-Za-z0-9_./-]*", text)
    return text if plain and not text.startswith("-") else json.dumps(text, ensure_ascii=False)


def _plain(value: float) -> str:
    """To four digits, as YAML reads a number: 1250.0, 1e-05."""
    return repr(float(f"{value:.4g}"))


def _number(value: float) -> str:
    return f"{value:.3e}".replace("e+", "e")
