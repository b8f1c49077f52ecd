"""The commented config of `strainsight init`: data of the deck and answers of the user are filled in, the rest is blank."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import BearingConfig
from strainsight.config.deck_properties import NONE, Answers, CandidateLocation, Suggestion
from strainsight.config.placement import PlacementConfig
from strainsight.config.suite import SuiteConfig
from strainsight.config.template_loads import channels, load_lines, location, named_loads, times, training
from strainsight.config.template_text import WORDS, escaped, exact, plain, quoted, scientific
from strainsight.errors import printable

POOL = {"modulus": 100, "load": 300}
"""Candidates for the elimination: for a load, the location of the largest strain is not the best."""

TEMPLATE = """\
# Where to bond strain gauges on {deck}.
# Fill in the blank lines marked ←, and check the other marked lines. `strainsight schema` describes every key. SI units
# unless a comment states another unit.
kind: placement
name: {name}    # results go to results/{name}
seed: 1                 # of the random number generator

mesh:
  file: {file}    # relative to the folder of this file
  length_unit: {length_unit:<8} # ← length unit of the deck: m, mm, cm, in, ft
  mass_unit: {mass_unit:<8}   # ← mass unit of the deck: kg, t, g, lb, slug, lbf*s2/in (t with mm and N)
{mesh}
# Uncertain material properties; if all are known: parameters: {{}}
{parameters}
# Forces, moments, pressures. List loads with `known: false` under place.estimate.
loads:
{loads}
damping: {{type: modal, ratio: 0.01}}         # ← or {{type: rayleigh, alpha: 0.0, beta: 1.0e-5}}; to estimate it: damping_factor

rom:
  modes: 10                       # enough modes for frequencies well above the load frequencies
  parameter_samples: 5
  tolerance: 1.0e-4

train:
{training}
gauges:
  surface: all                    # ← all exterior facets, or the name of a face, element set or node set
{direction}
  noise_std: {{value: 5.0e-7}}      # ← [strain] 0.5 µm/m, noise of an amplifier at 1 / train.time_step samples per second
{type}  # clearance: 0.005              # [m] to edges, supports and loads, or none; default: half the carrier diagonal
  # allow: [enclosed]             # places to keep that are excluded by default: enclosed, bores, loaded
{exclude}
screen:
  keep: {pool:<25} # number of candidates for the elimination, or all
{spacing}
place:
  estimate: {unknowns:<21} # ← parameters and loads from above
  keep: {keep:<25} # ← number of gauges to bond
  instants: 20                    # instants of the training simulation for the placement
  search: all                     # bound and layout of all candidates, not only of those that `screen` keeps
  aggregate: mean                 # criterion: mean or worst over the instants
  certificate: true               # compute a bound on the best possible layout

validate:
  truth:
    model: perturbed                   # simulated test with model error: more modes, other damping, misplaced gauges
{truth}{times}  initial_std: {initial:<18} # initial σ, relative to the guess or to the load amplitude
  random_sets: 10                 # number of random layouts for comparison
  noise_factors: [0.1, 5.0]       # other noise levels, relative to noise_std
  repeats: 20                     # runs with other seeds and initial values

{channels}
report: {{format: html}}
"""

PARAMETERS = """\
parameters:
  E:
    property: youngs_modulus      # or density, stiffness_factor of the region, thickness of its shells [m]
    region: {region:<8}              # ← id or name, or a list
    guess: {guess}              # ← [Pa]; or {{from: NAME}} for the estimate of another run
    range: {range}   # ← [Pa] range with the true value
    process_noise_scale: 0.05     # drift rate in the filter for placement [1/√s]
"""
FACTOR = """\
parameters:
  stiffness:
    property: stiffness_factor    # of the whole laminate; or density, thickness [m], or e1, e2, g12 of its plies [Pa]
    region: {region:<8}              # ← id or name, or a list
    guess: 1.0                    # the stiffness of the deck
    range: [0.8, 1.2]             # ← range with the true factor
    process_noise_scale: 0.05     # drift rate in the filter for placement [1/√s]
"""
MATERIAL = """\
    {name}: {{regions: {regions}, youngs_modulus: {E}, poisson_ratio: {nu}, density: {rho}}}
"""
CONE = """\
  exclude:                        # zones without gauges; other types: box, cylinder, near_edges, near_set (lengths in m)
    - normal_cone: {{axis: {axis}, angle: 10}}           # on facets normal to the axis, the direction is undefined
"""
TRUTH = "    parameters: {{{name}: {truth}}}      # ← {unit}assumed true value, which the filter has to estimate\n"
ALONG = "  direction: {{type: axis, axis: {axis}, angles: [0]}}   # ← axis is projected onto the facet; angles [deg]"
PRINCIPAL = (
    "  direction: {type: principal, angles: [0]}   # ← principal strain; or {type: axis, axis: [1, 0, 0], angles: [0]}"
)
TYPE = "  type: {name:<25} # ← grid [mm] / resistance [Ω]; sets grid, clearance, spacing, range. Other types: key `types`\n"
NO_TYPE = "  # type: 3/350                 # no carrier of the catalogue fits the faces of this part; other types: key `types`\n"
OPEN_TYPE = "  # type: 3/350                 # ← grid [mm] / resistance [Ω]; sets grid, clearance, spacing, range\n"
SPACING = "  # minimum_spacing: 0.011        # [m] between gauges; default: the longer side of the carrier\n"
OWN_SPACING = "  minimum_spacing: {spacing:<14} # ← [m] between gauges: the length of the carrier\n"
EXCLUDE = """\
  # exclude:                      # zones without gauges; other types: box, cylinder, near_edges, normal_cone (lengths in m)
  #   - NAME                       # a contact face of mesh.faces, or a set; the clearance is added
"""
ON_SEATS = """\
  exclude: [                      # zones without gauges; other types: box, cylinder, near_edges, normal_cone (lengths in m)
{lines}  ]
"""
FACES = 24
"""Largest number of faces that a config lists."""


def template(
    deck: str, suggestion: Suggestion | None = None, answers: Answers = NONE, first: float | None = None
) -> str:
    """Config for the deck at `deck` (path relative to the folder of the config); valid when no key is blank. first: first natural
    frequency [Hz], None if not computed."""
    suggestion = suggestion or Suggestion()
    name = run_name(deck)
    E = suggestion.youngs_modulus or (answers.material[0] if answers.material else None)
    modulus = answers.find == "modulus"
    parameter, value, unit = ("stiffness", 1.0, "") if suggestion.several_moduli else ("E", E, "[Pa] ")
    loads = named_loads(suggestion, answers, first)
    unknowns = [parameter] if modulus else [load.name for load in loads]
    keep = answers.keep or max(4, len(unknowns) + 1)
    train = training(loads, first)
    settled = modulus and "model: dynamic" in train
    # undecided for a deck without surface or with implausible units
    known = not suggestion.no_surface and suggestion.length_unit and not suggestion.thin
    kind = TYPE.format(name=suggestion.gauge_type) if suggestion.gauge_type else NO_TYPE if known else OPEN_TYPE
    return TEMPLATE.format(
        deck=escaped(deck),
        name=name,
        file=quoted(deck),
        length_unit=suggestion.length_unit,
        mass_unit=suggestion.mass_unit,
        mesh=_mesh(deck, suggestion, answers),
        parameters=_parameters(suggestion, E) if modulus else "parameters: {}\n",
        loads="".join(f"{line}\n" for load in loads for line in load_lines(load, suggestion, modulus)),
        training=train,
        direction=ALONG.format(axis=answers.axis) if answers.axis else PRINCIPAL,
        type=kind,
        spacing=SPACING if suggestion.gauge_type else OWN_SPACING.format(spacing=0.009),
        exclude=_exclude(suggestion, answers),
        unknowns=f"[{', '.join(unknowns)}]",
        keep=keep,
        pool="all" if suggestion.facets <= 2 * POOL[answers.find] else POOL[answers.find],
        truth=TRUTH.format(name=parameter, truth=scientific(1.05 * value if value else None), unit=unit)
        if modulus
        else "",
        times=times(train),
        initial=f"{{{', '.join(f'{unknown}: {0.1 if modulus else 1.0}' for unknown in unknowns)}}}",
        channels=channels(name, loads, keep, modulus, settled) if not suggestion.no_surface else "",
    )


def _named(suggestion: Suggestion, answers: Answers) -> dict[str, str]:
    """Faces named by the user: name → point."""
    support = answers.support
    faces = {suggestion.free("held"): support.name} if support is not None and support.kind == "face" else {}
    return faces | {
        load.face: load.answer.place.name
        for load in named_loads(suggestion, answers)
        if load.answer.place and load.face
    }


def _seats(suggestion: Suggestion, answers: Answers) -> dict[str, CandidateLocation]:
    """Probable contact faces, by the name of the user if there is one."""
    names_of_user = {suggestion.face_at(point): name for name, point in _named(suggestion, answers).items()}
    seats = [place for place in suggestion.places if place.lies_on]
    names = [suggestion.free("seat" if len(seats) == 1 else f"seat-{i + 1}") for i in range(len(seats))]
    return {names_of_user.get(place.name, name): place for name, place in zip(names, seats, strict=True)}


def _exclude(suggestion: Suggestion, answers: Answers) -> str:
    """Zones without gauges; each line can be removed separately."""
    cone = CONE.format(axis=answers.axis) if answers.axis else ""
    lines = ""
    for name, place in _seats(suggestion, answers).items():
        entry = f"- {name}" if cone else f"{name},"
        if place.instead_of:
            lines += (
                f"    # {entry:<27} # other side of the same bores: uncomment this line if this is the contact face\n"
            )
        else:
            lines += f"    {entry:<29} # ← probable contact face ({place.lies_on}); if not, remove this line\n"
    if not lines:
        return cone or EXCLUDE
    return f"{cone}{lines}" if cone else ON_SEATS.format(lines=lines)


def run_name(deck: str) -> str:
    """Name of the run, from that of the deck."""
    stem = re.split(r"[/\\\\]", deck)[-1].removesuffix(".gz").rsplit(".", 1)[0]
    name = re.sub(r"[^A-Za-z0-9]+", "-", stem).strip("-").lower()[:90]
    if not name[:1].isalpha() or name in WORDS:
        name = f"run-{name}".rstrip("-")
    return name


def _mesh(deck: str, suggestion: Suggestion, answers: Answers) -> str:
    """Faces, materials and supports that the file lacks, and its faces as comments."""
    named = _named(suggestion, answers)
    seats = {name: place for name, place in _seats(suggestion, answers).items() if name not in named}
    blank = not suggestion.supports and answers.support is None and not suggestion.thin
    lines = [f"  # {suggestion.odd}: add mesh.materials, or correct the deck"] if suggestion.odd else []
    if suggestion.unsupported:
        lines.append("  # Unsupported entities that affect the model. Add those that can be neglected to `ignore`:")
        lines += [f"  #   {printable(f'{n:<32} # number: {k}, first: {at}')}" for n, k, at in suggestion.unsupported]
        lines.append("  ignore: []            # ← names of the entities listed above that can be neglected")
    if suggestion.contact:
        pairs = f"{', '.join(suggestion.pairs[:3])}{', …' * (len(suggestion.pairs) > 3)}"
        lines.append(f"  # Contact of {printable(pairs)}. open: not connected, as in a *FREQUENCY step of CalculiX;")
        lines.append(
            "  # bonded: nodes of one surface follow the other surface (upper bound of stiffness). Compare both values."
        )
        why = (
            "with `open`, a part has no support"
            if suggestion.contact == "bonded"
            else "with `open`, all parts have supports"
        )
        lines.append(f"  contact: {suggestion.contact:<12} # ← bonded or open: {why}")
    if suggestion.support_sets:
        sets = ", ".join(map(str, suggestion.support_sets))
        chosen = f"{suggestion.support_key}: {'' if answers.spc is None else answers.spc:<16}"
        what = "active support set" if suggestion.support_key == "spc" else "step with the active supports and elements"
        lines.append(f"  {chosen} # ← {what}: {sets}")
    if faces := [place for place in suggestion.places if place.kind == "face"]:
        lines.append(
            "  # Faces of the surface, the largest first. A name in `faces` can be used like a set of the deck:"
        )
        for place in faces[:FACES]:
            support = f", {place.lies_on}: contact face?" if place.lies_on else ", supported" * place.supported
            lines.append(f"  #   near: {place.name:<32} # {place.what}{support}")
        if len(faces) > FACES:
            lines.append(f"  #   further faces: {len(faces) - FACES}; `strainsight import` lists all faces")
    if named or seats or blank:
        lines.append("  faces:")
        lines += [f"    {role}: {{near: {point}}}" for role, point in named.items()]
        lines += [f"    {name}: {{{entry.picked}}}    # {entry.lies_on}" for name, entry in seats.items()]
        if blank:
            lines.append(
                f"    {suggestion.free('held')}: {{near: }}        # ← [x, y, z] of a point on the supported face"
            )
    if suggestion.thin:
        lines.append(
            f"  sections:             # ← shells of the regions {printable(', '.join(suggestion.thin))}: thickness [m]"
        )
        lines.append("    shells: {regions: all, thickness: }")
    if suggestion.matrices:
        dof, sti, mas = (quoted(f"{deck.rpartition('.')[0]}{ending}") for ending in (".dof", ".sti", ".mas"))
        at = f", parameter: E, at: {exact(suggestion.youngs_modulus)}" if suggestion.youngs_modulus else ""
        lines += [
            "  # CalculiX matrices of the deck, instead of its elements; then remove `region` of the parameter:",
            f"  # matrices: {{numbering: {dof}, stiffness: [{{file: {sti}{at}}}], mass: [{{file: {mas}}}]}}",
        ]
    if suggestion.lacking:
        lines.append("  materials:            # missing or incomplete in the file ← [Pa], [-], [kg/m³]")
    for i, entry in enumerate(suggestion.lacking):
        E, nu, rho = answers.material or (None, None, None)
        E, nu = (E, nu) if entry.youngs_modulus is None else (entry.youngs_modulus, entry.poisson_ratio)
        name, regions = f"material-{i + 1}" if i else "material", list(entry.regions)
        lines.append(MATERIAL.format(name=name, regions=regions, E=exact(E), nu=plain(nu, 12), rho=plain(rho)).rstrip())
    if not suggestion.supports:
        on_face = blank or (answers.support is not None and answers.support.kind == "face")
        support = suggestion.free("held") if on_face else location(answers.support) if answers.support else ""
        node = answers.support is not None and answers.support.kind == "node"
        lines.append("  supports:             # missing in the file; for a free structure, use `free: true` instead")
        components = "[1, 2, 3, 4, 5, 6]" if suggestion.thin else "[1, 2, 3]"
        means = "1-3 translations, 4-6 rotations" if suggestion.thin else "1-3 translations"
        lines.append(f"    - {{{'node' if node else 'set'}: {support}, components: {components}}}   # ← {means}")
    return "".join(f"{line}\n" for line in lines)


def _parameters(suggestion: Suggestion, E: float | None) -> str:
    region = suggestion.region
    if suggestion.several_moduli:
        return FACTOR.format(region=region)
    low, high = (scientific(0.8 * E), scientific(1.2 * E)) if E else ("", "")
    return PARAMETERS.format(region=region, guess=exact(E), range=f"[{low}, {high}]" if E else "")


AnyConfig = Annotated[PlacementConfig | BenchConfig | BearingConfig | SuiteConfig, Field(discriminator="kind")]


def config_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of all kinds of config."""
    adapter: TypeAdapter[Any] = TypeAdapter(AnyConfig)
    schema = adapter.json_schema(by_alias=True)
    del schema["discriminator"]  # part of OpenAPI, not of the draft; `kind` is a constant in each model
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "strainsight config",
        "description": "A config; the key `kind` selects the kind of config.",
        **schema,
    }


def schema_text() -> str:
    """The schema as the text of docs/config.schema.json."""
    return json.dumps(config_schema(), indent=2, ensure_ascii=False) + "\n"
