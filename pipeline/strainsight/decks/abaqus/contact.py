"""*CONTACT PAIR of an Abaqus or CalculiX deck, in a linear model: bonded or open, as the config chooses."""

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
from strainsight.mesh.model import IntArray, Mesh
from strainsight.mesh.thin import concatenate

Contact = Literal["bonded", "open"]
COARSER = 1.5
"""Between the mean sizes of facets, from which a surface that follows is the coarser one."""
SHOWN = 6
"""Pairs that an error names."""


@dataclass(frozen=True)
class Pair:
    """A line of *CONTACT PAIR: the surface that follows where they are bonded, and the other; adjust: how far off its nodes may
    lie, None where the deck does not say; tied: the deck ties them."""

    row: Row
    first: Surface
    second: Surface
    adjust: float | None
    tied: bool

    def __str__(self) -> str:
        return f"{self.first.name} on {self.second.name}"


def with_contact(
    mesh: Mesh,
    surfaces: Surfaces,
    keywords: Sequence[Keyword],
    choice: Contact | None,
    removed: Collection[tuple[str, str]],
) -> Mesh:
    """A mesh in which the surfaces of contact pairs are bonded, the nodes of the first following the facets of the second that
    they lie on, see `with_surface_tie`, or are open, and not connected; `contacts` says so of each. Pairs whose interaction has
    PRESSURE-OVERCLOSURE=TIED (CalculiX), or that are TIED (Abaqus), are bonded always; those that *MODEL CHANGE has removed are
    open.

    Nodes that are farther off than ADJUST, or than `TOLERANCE` of a facet, stay open, and so do those that follow something
    already, or that the other surface follows. Raises ContactError where there is a pair and no choice, DeckError for surfaces
    that are not in the deck, and where surfaces of shells are to be bonded.
    """
    pairs = list(_pairs(surfaces, keywords))
    gone = [(pair.row.text(0).upper(), pair.row.text(1).upper()) in removed for pair in pairs]
    asked = [pair for pair, out in zip(pairs, gone, strict=True) if not (pair.tied or out)]
    if asked and choice is None:
        listed = [f"{pair} ({pair.row.where})" for pair in asked[:SHOWN]]
        more = f" and {len(asked) - SHOWN} more" if len(asked) > SHOWN else ""
        raise ContactError(
            f"surfaces in contact, which a linear model holds together or apart: {', '.join(listed)}{more}",
            where=asked[0].row.where,
            remedy="mesh.contact: bonded, what touches is tied, the stiffest it can be; or mesh.contact: open, nothing "
            "connects it, as in a *FREQUENCY step of CalculiX without PERTURBATION",
            choices=tuple(map(str, asked)),
        )
    said: list[str] = []
    for i, pair in enumerate(pairs):
        turned = [
            own
            for own, out in zip(pairs[:i], gone[:i], strict=True)
            if not out and own.first is pair.second and own.second is pair.first
        ]
        if gone[i]:
            words = "open: *MODEL CHANGE removes it"
        elif any(own.tied or not pair.tied for own in turned):
            words = "that of the pair above, the other way round"
        elif pair.tied or choice == "bonded":
            mesh, words = _bonded(mesh, pair)
        else:
            words = "open (mesh.contact): nothing connects them, however the deck presses them together"
        said.append(f"contact of {pair}: {words}")
    return replace(mesh, contacts=tuple(said))


def _pairs(surfaces: Surfaces, keywords: Sequence[Keyword]) -> Iterator[Pair]:
    tying = _tying(keywords)
    for scope, keyword in surfaces.assembly.keywords("CONTACTPAIR", of_steps=True):
        given = keyword.parameters.get("ADJUST", "")
        tied = "TIED" in keyword.parameters or keyword.word("INTERACTION") in tying
        for row in keyword.rows():
            yield Pair(row, *surfaces.find_pair(scope, row), parse_real(given) if given else None, tied)


def _tying(keywords: Sequence[Keyword]) -> set[str]:
    """Names, in capitals, of the interactions that tie: a *SURFACE BEHAVIOR belongs to the *SURFACE INTERACTION before it."""
    names, current = set(), ""
    for keyword in keywords:
        if keyword.name == "SURFACEINTERACTION":
            current = keyword.word("NAME")
        elif keyword.name == "SURFACEBEHAVIOR" and keyword.word("PRESSURE-OVERCLOSURE") == "TIED":
            names.add(current)
    return names


def _bonded(mesh: Mesh, pair: Pair) -> tuple[Mesh, str]:
    """The mesh with a pair tied, and what became of it."""
    if pair.first is pair.second:
        return mesh, "open: a surface with itself"
    nodes = np.setdiff1d(pair.first.nodes, pair.second.nodes)
    shared = len(pair.first.nodes) - len(nodes)
    if not len(nodes):
        return mesh, "they have the same nodes, and are one"
    if not pair.second.facets:
        raise pair.row.error(f"surface {pair.second.name} is of nodes, which nothing can follow", "write its facets")
    size = facet_size(mesh, pair.first, pair.second)
    if size is None:
        raise pair.row.error(
            f"{pair} joins shells or beams, which are not bonded",
            "join them by *TIE, nodes or mesh.ties, and leave the pair open (mesh.contact: open)",
        )
    within = TOLERANCE * size if pair.adjust is None else max(pair.adjust, TOLERANCE * size)
    free = np.setdiff1d(nodes, following_already(mesh))
    able = np.setdiff1d(free, _followed_by(mesh, pair.second.nodes))
    try:
        mesh, tied = (
            following(mesh, pair.row, able, pair.second.nodes, within, "*CONTACT PAIR") if len(able) else (mesh, 0)
        )
    except UserError:
        tied = 0
    left = [f"{shared} are nodes of both"] if shared else []
    left += [f"{len(nodes) - len(free)} follow something already"] if len(free) < len(nodes) else []
    left += [f"{len(free) - len(able)} are followed by the other surface"] if len(able) < len(free) else []
    left += [f"{len(able) - tied} lie more than {within:.3g} off and stay open"] if tied < len(able) else []
    own = facet_size(mesh, pair.second, pair.first)
    if tied and own is not None and own > COARSER * size:
        left += [f"the finer surface is free between them: name {pair.second.name} first"]
    how = "TIED in the deck" if pair.tied else "mesh.contact"
    bound = "" if pair.tied or not tied else "; what may open or slide is stiffer here than it is"
    return mesh, f"{tied} of {len(pair.first.nodes)} nodes bonded ({how}){''.join(f', {own}' for own in left)}{bound}"


def following_already(mesh: Mesh) -> IntArray:
    """Nodes whose motions, or some of them, follow others by ties and relations."""
    led = [own.nodes for own in mesh.rigid] + [np.array([own.reference]) for own in mesh.averaging]
    led += [own.node[:1] for own in mesh.relations]
    return np.unique(concatenate(led))


def _followed_by(mesh: Mesh, nodes: IntArray) -> IntArray:
    """Nodes that some of `nodes` (m,) follow by relations: to follow these in turn would be a circle."""
    ahead = [own.node[1:] for own in mesh.relations if np.isin(own.node[0], nodes)]
    return np.unique(concatenate(ahead))
