"""Beams and rods of a Nastran deck: CBAR, CBEAM, CROD, CTUBE and CONROD."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.decks.faults import folded
from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.grids import Grids
from strainsight.decks.nastran.supports import components
from strainsight.decks.numbers import parse_integer, parse_real
from strainsight.mesh.given_sections import beam_axes
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import BeamBlock

BEAMS, RODS = ("CBAR", "CBEAM"), ("CROD", "CTUBE", "CONROD")
DEFAULTS = {"CBAR": "BAROR", "CBEAM": "BEAMOR"}
APART = 1e-9
"""Length of an element over the extent of the model, below which its ends coincide."""


def with_defaults(cards: dict[str, list[Card]]) -> dict[str, list[Card]]:
    """CBAR and CBEAM by name, in whose blank PID, X1 to X3 (or G0) and OFFT stands what BAROR and BEAMOR say."""
    found: dict[str, list[Card]] = {}
    for name, default in DEFAULTS.items():
        given = cards.get(default, [])
        if len(given) > 1:
            raise given[1].error(f"a second one (first at {given[0].where})", f"keep one {default}")
        found[name] = [_filled(card, given[0]) for card in cards.get(name, [])] if given else cards.get(name, [])
    return found


def _filled(card: Card, default: Card) -> Card:
    fields = [*card.fields, *[""] * (8 - len(card.fields))]
    for group in ((1,), (4, 5, 6), (7,)):
        if not any(fields[i] for i in group):
            for i in group:
                fields[i] = "" if i == 1 and default.text(1) == "0" else default.text(i)
    return card._replace(fields=fields)


def read_beams(cards: Sequence[Card], ids: IntArray, region: IntArray, grids: Grids) -> tuple[BeamBlock, ...]:
    """Beams and rods, whose ids and regions are (n,).

        x from GA + WA to GB + WB,     z = x × v/|x × v|,   y = z × x,     v = X1 to X3 in the system CD of GA, or GA to G0

    Raises DeckError for a missing or repeated node, ends that coincide, an orientation along the axis or none, an end that is
    released altogether, offsets along the element (OFFT).
    """
    extent = float(np.ptp(grids.position, axis=0).max())
    blocks = []
    for kind, names in (("beam", BEAMS), ("rod", RODS)):
        rows = np.flatnonzero([card.name in names for card in cards])
        if not rows.size:
            continue
        own = [cards[i] for i in rows.tolist()]
        given = np.array(
            [[card.integer((1 if card.name == "CONROD" else 2) + i, "a node id") for i in (0, 1)] for card in own],
            dtype=np.int64,
        )
        nodes = grids.nodes.rows_of_cards(given, own)
        if (at := folded(nodes)) is not None:
            raise own[at].error("both ends are on one node", "give it two nodes, or take it out")
        n = len(own)
        offset, released = np.zeros((n, 2, 3)), np.zeros((n, 2, 6), dtype=bool)
        if kind == "beam":
            for i, card in enumerate(own):
                _check_offt(card)
                for end in (0, 1):
                    offset[i, end] = _offset(card, end, int(nodes[i, end]), grids)
                    released[i, end, _released(card, end)] = True
        along = np.diff(grids.position[nodes] + offset, axis=1)[:, 0]
        length = np.linalg.norm(along, axis=1)
        short = ~(length > APART * extent)
        if short.any():
            raise own[int(np.argmax(short))].error("its ends coincide", "move a node or an offset, or take it out")
        if kind == "beam":
            v = np.array([_orientation(card, int(A), grids) for card, A in zip(own, nodes[:, 0], strict=True)])
        else:
            v = np.eye(3)[np.argmin(np.abs(along), axis=1)]
        axes, lost = beam_axes(along, v)
        if lost.any():
            raise own[int(np.argmax(lost))].error("G0 or X1 to X3 lie on its axis", "give a point or vector off it")
        blocks.append(BeamBlock(kind, ids[rows], nodes, region[rows], axes, offset, released))
    return tuple(blocks)


def _check_offt(card: Card) -> None:
    """GGG, or BGG where the orientation is along the basic axes; 1 and 2 are flags of old decks."""
    text = card.text(7).upper()
    offset = any(card.text(i) and card.real(i, "an offset") != 0 for i in range(10, 16))
    if text in ("", "1", "2", "GGG", "BGG") or (text in ("GGO", "GOG", "GOO", "BGO", "BOG", "BOO") and not offset):
        return
    if parse_real(text) is not None:
        raise card.error(f"BIT is {text}: a twist built in is not supported", "leave the field blank")
    raise card.error(
        f"OFFT is {text}: only offsets along the systems CD of the nodes are supported", "give OFFT as GGG or BGG"
    )


def _offset(card: Card, end: int, row: int, grids: Grids) -> FloatArray:
    """WA or WB along the basic axes."""
    own = [card.real(10 + 3 * end + i, "an offset", 0.0) for i in range(3)]
    return np.asarray(grids.axes.get(row, np.eye(3)) @ own)


def _released(card: Card, end: int) -> list[int]:
    """Pin flags PA or PB as components."""
    text = card.text(8 + end)
    if text in ("", "0"):
        return []
    found = components(text, card)
    if len(found) > 5:
        raise card.error(f"end {'AB'[end]} is released altogether", "take the element out, or hold one motion")
    return list(found)


def _orientation(card: Card, A: int, grids: Grids) -> FloatArray:
    """The vector v (3,), along the basic axes."""
    if card.text(4) and not (card.text(5) or card.text(6)) and parse_integer(card.text(4)) is not None:
        return np.asarray(grids.position[grids.nodes.row(card.integer(4, "the node G0"), card)] - grids.position[A])
    if not any(card.text(i) for i in (4, 5, 6)):
        raise card.error(
            f"neither G0 nor X1 to X3 give its plane, nor does a {DEFAULTS[card.name]}", "give one of them"
        )
    v = np.array([card.real(i, "a component of X", 0.0) for i in (4, 5, 6)])
    axes = np.eye(3) if card.text(7).upper().startswith("B") else grids.axes.get(A, np.eye(3))
    return np.asarray(axes @ v)
