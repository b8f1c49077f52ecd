"""Steps that leave a preload: what vibrates after them is stiffer or softer than the part without load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.faults import PRELOAD

LARGE = "*STEP, NLGEOM"
"""Large displacements, where no modes follow."""
STRESSED = "*INITIAL CONDITIONS, TYPE=STRESS"
MODAL = {
    *("FREQUENCY", "COMPLEXFREQUENCY", "STEADYSTATEDYNAMICS", "MODALDYNAMIC", "RANDOMRESPONSE", "RESPONSESPECTRUM"),
    "SUBSTRUCTUREGENERATE",
}
LOADS = {"CLOAD", "DLOAD", "DSLOAD", "BOUNDARY", "TEMPERATURE"}


@dataclass
class Step:
    """Its *STEP, the names of the keywords up to *END STEP, and whether displacements are large, which goes on from step to step
    until NLGEOM=NO."""

    keyword: Keyword
    large: bool
    inside: set[str] = field(default_factory=set)


def preloads(keywords: Sequence[Keyword]) -> dict[str, list[Keyword]]:
    """Cards as `Mesh.ignored` names them → where they stand.

    "PRELOAD by *STEP, NLGEOM": steps of large displacements before modes, which count in Abaqus, and in CalculiX beside
    PERTURBATION; "PRELOAD by *STEP, PERTURBATION": modes that in CalculiX are about the loads of a static step before. Abaqus
    asks for NLGEOM there, and a deck that states NLGEOM=NO is one of Abaqus.
    """
    found: dict[str, list[Keyword]] = {}
    bent: list[Keyword] = []
    loaded = False
    for step in _steps(keywords):
        stated = step.keyword.parameters
        if not step.inside & MODAL:
            bent += [step.keyword] if step.large else []
            loaded |= "STATIC" in step.inside and "NLGEOM" not in stated and bool(step.inside & LOADS)
        elif bent:
            found.setdefault(f"{PRELOAD} by {LARGE}", []).extend(bent)
            bent = []
        elif loaded and "PERTURBATION" in stated and "NLGEOM" not in stated:
            found.setdefault(f"{PRELOAD} by *STEP, PERTURBATION", []).append(step.keyword)
    return found | ({LARGE: bent} if bent else {})


def stressed(keywords: Sequence[Keyword]) -> list[Keyword]:
    """*INITIAL CONDITIONS that state stress."""
    return [
        own
        for own in keywords
        if own.name == "INITIALCONDITIONS" and own.parameters.get("TYPE", "").upper() == "STRESS"
    ]


def _steps(keywords: Sequence[Keyword]) -> list[Step]:
    found: list[Step] = []
    for keyword in keywords:
        if keyword.name == "STEP":
            stated = keyword.parameters.get("NLGEOM")
            large = (bool(found) and found[-1].large) if stated is None else stated.upper() != "NO"
            found.append(Step(keyword, large))
        elif found:
            found[-1].inside.add(keyword.name)
    return found
