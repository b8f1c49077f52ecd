"""Candidate gauges as datasets of an artefact, and back."""

from __future__ import annotations

from strainsight.gauges.candidates import Candidates
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset

GROUP = "/gauges"
COLUMNS = {
    "element": ("1", "element id of every candidate"),
    "facet": ("1", "facet number within the element, from 1, in the order of docs/artefacts.md"),
    "kind": ("1", "kind of the facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8"),
    "nodes": ("1", "node indices of the facet, −1 where it has fewer (candidate × 8)"),
    "position": ("m", "facet centre (candidate × xyz)"),
    "normal": ("1", "outward normal (candidate × xyz)"),
    "direction": ("1", "measuring direction, in the facet's plane (candidate × xyz)"),
    "angle": ("deg", "from the projected axis, right-handed about the outward normal"),
}


def candidate_datasets(pool: Candidates) -> dict[str, Dataset]:
    """Every column of the candidates."""
    return {f"{GROUP}/{name}": Dataset(getattr(pool, name), unit, what) for name, (unit, what) in COLUMNS.items()}


def candidates_from(artefact: Artefact) -> Candidates:
    """The candidates that `candidate_datasets` wrote."""
    return Candidates(**{name: artefact[f"{GROUP}/{name}"] for name in COLUMNS})
