"""*CONTACT PAIR of an Abaqus or CalculiX deck in a linear model: bonded or open, as set in the config."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from strainsight.decks.abaqus.surfaces import Surface, Surfaces
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.abaqus.ties import TOLERANCE, facet_size, following
from strainsight.decks.text import parse_real
from strainsight.errors import ContactError, UserError
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import concatenate

Contact = Literal["bonded", "open"]
COARSER = 1.5
"""Ratio of mean facet sizes from which the first surface counts as the coarser one."""
SHOWN = 6
"""Number of pairs listed in an error."""


@dataclass(frozen=True)
class Pair:
    """A line of *CONTACT PAIR: the slave surface, if bonded, and the master surface; adjust: largest distance of
    slave nodes, None if not in the deck; tied: the deck ties the pair."""

    row: Row
    first: Surface
    second: Surface
    adjust: float | None
    tied: bool

    def __str__(self) -> str:
        slave, master = self.first.name, self.second.name
        return f"{slave} on {master}"


def with_contact(
    mesh: Mesh,
    surfaces: Surfaces,
    keywords: Sequence[Keyword],
    choice: Contact | None,
    removed: Collection[tuple[str, str]],
) -> Mesh:
    """Mesh in which contact pairs are bonded or open; `contacts` reports the treatment of each pair.

    In a bonded pair, nodes of the first surface follow the facets of the second surface on which they lie, see
    `with_surface_tie`. Pairs whose interaction has PRESSURE-OVERCLOSURE=TIED (CalculiX), or that are TIED (Abaqus),
    are always bonded; pairs removed by *MODEL CHANGE are open. Nodes farther away than ADJUST or `TOLERANCE` of a
    facet stay open, and so do nodes that already follow other nodes or that the other surface follows. Raises
    ContactError for a pair without a choice, DeckError for missing surfaces and for bonded surfaces of shells."""
    pairs = list(_pairs(surfaces, keywords))
    removed_pairs = [(pair.row.text(0).upper(), pair.row.text(1).upper()) in removed for pair in pairs]
    undecided = [pair for pair, out in zip(pairs, removed_pairs, strict=True) if not (pair.tied or out)]
    if undecided and choice is None:
        listed = [f"{pair} ({pair.row.where})" for pair in undecided[:SHOWN]]
        more = f" and {len(undecided) - SHOWN} more pairs" if len(undecided) > SHOWN else ""
        raise ContactError(
            "the deck has surfaces in contact, but a linear model cannot open or close contacts: "
            f"{', '.join(listed)}{more}",
            where=undecided[0].row.where,
            remedy="set mesh.contact: bonded (ties the surfaces where they touch: upper limit of the stiffness) or "
            "mesh.contact: open (no connection, as in a *FREQUENCY step of CalculiX without PERTURBATION)",
            choices=tuple(map(str, undecided)),
        )
    sentences: list[str] = []
    for i, pair in enumerate(pairs):
        reversed_pairs = [
            other
            for other, out in zip(pairs[:i], removed_pairs[:i], strict=True)
            if not out and other.first is pair.second and other.second is pair.first
        ]
        if removed_pairs[i]:
            words = "the contact is open, because *MODEL CHANGE removes this pair"
        elif any(other.tied or not pair.tied for other in reversed_pairs):
            words = f"this contact is already included in the contact of {reversed_pairs[0]}"
        elif pair.tied or choice == "bonded":
            mesh, words = _bond(mesh, pair)
        else:
            words = (
                "the contact is open (mesh.contact): the surfaces are not connected, even if they press on each other"
            )
        sentences.append(f"contact of {pair}: {words}")
    return replace(mesh, contacts=tuple(sentences))


def _pairs(surfaces: Surfaces, keywords: Sequence[Keyword]) -> Iterator[Pair]:
    tying = _tying_interactions(keywords)
    for scope, keyword in surfaces.assembly.keywords("CONTACTPAIR", of_steps=True):
        adjust = keyword.parameters.get("ADJUST", "")
        tied = "TIED" in keyword.parameters or keyword.word("INTERACTION") in tying
        for row in keyword.rows():
            # a line with one name is the contact of a surface with itself
            first, second = (surfaces.find(row.text(i) or row.text(0), scope, row) for i in (0, 1))
            yield Pair(row, first, second, parse_real(adjust) if adjust else None, tied)


def _tying_interactions(keywords: Sequence[Keyword]) -> set[str]:
    """Names, in capitals, of the interactions that tie surfaces; a *SURFACE BEHAVIOR belongs to the preceding
    *SURFACE INTERACTION."""
    names, current = set(), ""
    for keyword in keywords:
        if keyword.name == "SURFACEINTERACTION":
            current = keyword.word("NAME")
        elif keyword.name == "SURFACEBEHAVIOR" and keyword.word("PRESSURE-OVERCLOSURE") == "TIED":
            names.add(current)
    return names


def _bond(mesh: Mesh, pair: Pair) -> tuple[Mesh, str]:
    """Mesh with a bonded pair, and a sentence on the result."""
    if pair.first is pair.second:
        return mesh, "the contact is open, because a surface cannot be bonded to itself"
    nodes = np.setdiff1d(pair.first.nodes, pair.second.nodes)
    shared = len(pair.first.nodes) - len(nodes)
    if not len(nodes):
        return mesh, "both surfaces have the same nodes, so the surfaces are already connected"
    if not pair.second.facets:
        raise pair.row.error(
            f"the second surface of a bonded contact needs facets, but {pair.second.name} consists of nodes only",
            f"define surface {pair.second.name} by element facets (*SURFACE, TYPE=ELEMENT)",
        )
    if (size := facet_size(mesh, pair.first, pair.second)) is None:
        raise pair.row.error(
            f"the contact of {pair} includes shells or beams, but only solids can be bonded",
            "set mesh.contact: open, and join the parts by common nodes or by mesh.ties of type rigid or averaging",
        )
    within = TOLERANCE * size if pair.adjust is None else max(pair.adjust, TOLERANCE * size)
    led = [tie.nodes for tie in mesh.rigid] + [np.array([tie.reference]) for tie in mesh.averaging]
    led += [tie.node[:1] for tie in mesh.relations]
    free = np.setdiff1d(nodes, concatenate(led))
    # tying nodes to nodes that follow them by relations would be circular
    ahead = [relation.node[1:] for relation in mesh.relations if np.isin(relation.node[0], pair.second.nodes)]
    able = np.setdiff1d(free, concatenate(ahead))
    try:
        mesh, tied = (
            following(mesh, pair.row, able, pair.second.nodes, within, "*CONTACT PAIR") if len(able) else (mesh, 0)
        )
    except UserError:
        tied = 0
    other = pair.second.name
    reasons = {
        "they belong to both surfaces": shared,
        "they are dependent in another tie or contact": len(nodes) - len(free),
        f"nodes of {other} are tied to them": len(free) - len(able),
        f"they are farther than {within:.3g} length units of the deck from {other}": len(able) - tied,
    }
    left = [f"nodes not bonded because {reason}: {count}" for reason, count in reasons.items() if count]
    second_size = facet_size(mesh, pair.second, pair.first)
    if tied and second_size is not None and second_size > COARSER * size:
        left += [
            f"some nodes of {other} are not bonded, because {other} has the finer mesh: write {other} first in this *CONTACT PAIR"
        ]
    how = "TIED in the deck" if pair.tied else "mesh.contact: bonded"
    bound = "" if pair.tied or not tied else "; the model is too stiff where the contact may open or slide"
    count = len(pair.first.nodes)
    return (
        mesh,
        f"{tied} of {count} nodes of {pair.first.name} are bonded ({how}){''.join(f'; {part}' for part in left)}{bound}",
    )
