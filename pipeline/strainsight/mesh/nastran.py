"""Nastran decks: solids, materials, supports, rigid elements and masses; the rest is counted, never dropped."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.cards import Card, Deck, parse_integer, read_deck
from strainsight.mesh.coordinates import KINDS, CoordinateSystem, coordinate_systems, to_basic
from strainsight.mesh.model import ELEMENT_KINDS, CellBlock, FloatArray, IntArray, Material, Mesh, Region
from strainsight.mesh.nastran_sets import sets
from strainsight.mesh.nastran_ties import NodeTable, averaging_elements, fixed_components, point_masses, rigid_elements

SOLIDS = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
}
OTHER_SOLIDS = ("CTETR", "CHEX", "CPENT", "CPYR", "CTRIAX", "CTRAX", "CQUADX")
TO_VTK = {
    # Nastran numbers the mid-sides bottom, uprights, top; VTK bottom, top, uprights.
    "hex20": (*range(12), 16, 17, 18, 19, 12, 13, 14, 15),
    "wedge15": (*range(9), 12, 13, 14, 9, 10, 11),
}
TAKEN = {"GRID", "PSOLID", "MAT1", "SPC", "SPC1", "SPCADD", "RBE2", "RBE3", "CONM2", "SET1", "SET3", *SOLIDS, *KINDS}


def read_nastran(path: Path) -> Mesh:
    """A Nastran deck in its own units, with its own ids.

    Taken over: GRID (CP; PS), CORD2R/C/S, CTETRA, CHEXA, CPENTA (linear and quadratic), PSOLID, MAT1, SPC, SPC1,
    SPCADD, RBE2, RBE3, CONM2 (mass), SET1, SET3, case-control SPC and SET, PARAM WTMASS, INCLUDE. Every other
    card is in `ignored` with its count. SET 5 of the case control is the set "SET-5", SET1 5 of the bulk data "SET1-5".
    Without a selection in the case control the only set of supports counts.
    Raises DeckError with file:line for what cannot be taken over as it stands.
    """
    path = Path(path)
    deck = read_deck(path)
    cards = deck.cards
    ignored: Counter[str] = Counter()
    systems = coordinate_systems(cards)
    nodes, position, permanent = _grids(cards, systems, ignored, path)
    blocks = _solids(cards, nodes, path)
    regions, materials = _properties(cards, blocks, ignored)
    scale = _mass_scale(cards)
    materials = {i: Material(m.id, m.youngs_modulus, m.poisson_ratio, scale * m.density) for i, m in materials.items()}
    rigid = rigid_elements(cards, nodes)
    averaging = averaging_elements(cards, nodes)
    _check_tie_ids(cards)
    fixed = fixed_components(deck, nodes, permanent, ignored)
    element_ids = np.sort(np.concatenate([block.ids for block in blocks]))
    node_sets, element_sets = sets(deck, np.sort(nodes.ids), element_ids, ignored)
    masses = point_masses(cards, nodes, scale, ignored)
    _count_ignored(deck, ignored)
    return Mesh(
        node_ids=nodes.ids,
        position=position,
        blocks=blocks,
        regions=regions,
        materials=materials,
        fixed=fixed,
        rigid=rigid,
        averaging=averaging,
        point_masses=masses,
        node_sets=node_sets,
        element_sets=element_sets,
        ignored=dict(sorted(ignored.items())),
        source=str(path),
        included=deck.included,
    )


def _grids(
    cards: dict[str, list[Card]], systems: dict[int, CoordinateSystem], ignored: Counter[str], path: Path
) -> tuple[NodeTable, FloatArray, list[tuple[Card, int, str]]]:
    """Node table, basic position (n, 3), and permanent supports (card, node index, components)."""
    grids = cards.get("GRID", [])
    if not grids:
        raise DeckError(
            "the deck holds no GRID card", where=str(path), remedy="check that this is the deck of the model"
        )
    if "GRDSET" in cards:
        raise cards["GRDSET"][0].error("GRDSET is not taken over", "write its values on the GRID cards")
    ids = _unique_ids(grids, "node")
    local = np.array([[card.real(i, "a coordinate", 0.0) for i in (2, 3, 4)] for card in grids])
    system = np.array([card.integer(1, "the system CP", 0) for card in grids])
    output = np.array([card.integer(5, "the system CD", 0) for card in grids])
    for cid in np.unique(system):
        if int(cid) not in systems:
            raise grids[int(np.argmax(system == cid))].error(
                f"coordinate system {cid} is no CORD2R, CORD2C or CORD2S of the deck",
                "write the system as a CORD2 card, or the point in the basic system",
            )
    if np.any(output):
        ignored["GRID displacement system CD"] += int(np.count_nonzero(output))
    permanent = [(card, i, card.fields[6]) for i, card in enumerate(grids) if card.text(6) not in ("", "0")]
    return NodeTable(ids, output != 0), to_basic(local, system, systems), permanent


def _unique_ids(cards: list[Card], what: str) -> IntArray:
    """Ids (n,) of the cards, positive and each once."""
    ids = np.array([card.integer(0, f"the {what} id") for card in cards], dtype=np.int64)
    if ids.size and ids.min() < 1:
        raise cards[int(np.argmin(ids))].error(f"the {what} id must be positive")
    order = np.argsort(ids, kind="stable")
    again = np.flatnonzero(np.diff(ids[order]) == 0)
    if again.size:
        first, second = cards[order[again[0]]], cards[order[again[0] + 1]]
        raise DeckError(
            f"{what} id {second.fields[0]} stands twice (first at {first.where})",
            where=second.where,
            remedy=f"give every {what} its own id",
        )
    return ids


def _solids(cards: dict[str, list[Card]], nodes: NodeTable, path: Path) -> tuple[CellBlock, ...]:
    for name, found in cards.items():
        if name.startswith(OTHER_SOLIDS) and name not in SOLIDS:
            raise found[0].error(
                f"{name} solids are not taken over ({len(found)} in the deck)",
                "mesh with tetrahedra, hexahedra or wedges (CTETRA, CHEXA, CPENTA)",
            )
    elements = sorted(
        (card for name in SOLIDS for card in cards.get(name, [])), key=lambda card: (card.file, card.line)
    )
    if not elements:
        raise DeckError(
            "the deck holds no solid element", where=str(path), remedy="the model needs CTETRA, CHEXA or CPENTA"
        )
    ids = _unique_ids(elements, "element")
    gathered: dict[str, list[tuple[int, int, list[int]]]] = {}
    for i, card in enumerate(elements):
        kind, node_ids = _connectivity(card)
        gathered.setdefault(kind, []).append((i, card.integer(1, "the property id", int(ids[i])), node_ids))
    blocks = []
    for kind in ELEMENT_KINDS:
        if kind not in gathered:
            continue
        rows, region, connectivity = zip(*gathered[kind], strict=True)
        own = [elements[i] for i in rows]
        index = nodes.rows_of_cards(np.array(connectivity, dtype=np.int64), own)
        _check_distinct(index, own)
        order = list(TO_VTK.get(kind, range(index.shape[1])))
        blocks.append(CellBlock(kind, ids[list(rows)], index[:, order], np.array(region, dtype=np.int64)))
    return tuple(blocks)


def _connectivity(card: Card) -> tuple[str, list[int]]:
    """Element kind and node ids, in the order of the card."""
    tokens = card.fields[2:]
    while tokens and tokens[-1] in ("", "0"):
        tokens = tokens[:-1]
    counts = SOLIDS[card.name]
    few, many = sorted(counts)
    if few < len(tokens) <= many and (len(tokens) < many or any(token in ("", "0") for token in tokens[few:])):
        given = sum(token not in ("", "0") for token in tokens[few:])
        raise card.error(
            f"{given} of {many - few} mid-side nodes", f"give all mid-side nodes, or none ({few} or {many} nodes)"
        )
    if len(tokens) not in counts:
        raise card.error(
            f"{len(tokens)} nodes, where a {card.name} has {few} or {many}", "give the nodes of a whole element"
        )
    node_ids = [parse_integer(token) for token in tokens]
    for i, value in enumerate(node_ids):
        if value is None:
            card.integer(i + 2, "a node id")
    return counts[len(tokens)], node_ids  # type: ignore[return-value]


def _check_distinct(index: IntArray, cards: list[Card]) -> None:
    """No element with a node twice, no two elements on the same nodes."""
    ordered = np.sort(index, axis=1)
    folded = np.any(np.diff(ordered, axis=1) == 0, axis=1)
    if folded.any():
        raise cards[int(np.argmax(folded))].error(
            "a node stands twice in the element", "replace collapsed elements by wedges or tetrahedra"
        )
    by_nodes = np.lexsort(ordered.T)
    same = np.flatnonzero(np.all(np.diff(ordered[by_nodes], axis=0) == 0, axis=1))
    if same.size:
        a, b = sorted((int(by_nodes[same[0]]), int(by_nodes[same[0] + 1])))
        raise cards[b].error(
            f"the same nodes as {cards[a].name} {cards[a].fields[0]} at {cards[a].where}",
            "remove one of the two: together they count stiffness and mass twice",
        )


def _properties(
    cards: dict[str, list[Card]], blocks: tuple[CellBlock, ...], ignored: Counter[str]
) -> tuple[dict[int, Region], dict[int, Material]]:
    """PSOLID → regions, and the MAT1 that they refer to."""
    solids, isotropic = cards.get("PSOLID", []), cards.get("MAT1", [])
    _unique_ids(solids, "property")
    material_cards = dict(zip(_unique_ids(isotropic, "material").tolist(), isotropic, strict=True))
    regions, materials = {}, {}
    for card in solids:
        pid, mid = card.integer(0, "the property id"), card.integer(1, "the material id")
        if card.text(6).upper() not in ("", "SMECH"):
            raise card.error(f"FCTN is {card.text(6)}: only structural solids are taken over", "remove the fluid part")
        if mid not in material_cards:
            other = [
                name for name in cards if name.startswith("MAT") and any(c.text(0) == str(mid) for c in cards[name])
            ]
            raise card.error(
                f"material {mid} is {'a ' + other[0] if other else 'not in the deck'}",
                "give the region an isotropic MAT1" if other else f"add a MAT1 card with id {mid}",
            )
        regions[pid] = Region(pid, f"PSOLID {pid}", mid)
        if mid not in materials:
            materials[mid] = _material(material_cards[mid])
    if unused := len(material_cards) - len(materials):
        ignored["MAT1 that no PSOLID refers to"] += unused
    for block in blocks:
        missing = ~np.isin(block.region, list(regions))
        if missing.any():
            i = int(np.argmax(missing))
            card = next(c for name in SOLIDS for c in cards.get(name, []) if int(c.fields[0]) == block.ids[i])
            raise card.error(
                f"property {block.region[i]} is no PSOLID of the deck ({int(missing.sum())} {block.kind} elements)",
                f"add a PSOLID card with id {block.region[i]}",
            )
    return regions, materials


def _material(card: Card) -> Material:
    """MAT1: two of E, G, ν give the third, E = 2 (1 + ν) G."""
    given = [bool(card.text(i)) for i in (1, 2, 3)]
    E, G, nu = (
        card.real(i, name, 0.0)
        for i, name in ((1, "Young's modulus E"), (2, "shear modulus G"), (3, "Poisson's ratio"))
    )
    if sum(given) < 2:
        raise card.error("needs two of E, G and NU", "give E and NU")
    for name, value, there in (("Young's modulus", E, given[0]), ("the shear modulus", G, given[1])):
        if there and value <= 0:
            raise card.error(f"{name} is {value:g}, not positive", "give a positive modulus")
    if not given[0]:
        E = 2 * (1 + nu) * G
    if not given[2]:
        nu = E / (2 * G) - 1
    if not -1 < nu < 0.5:
        raise card.error(
            f"Poisson's ratio is {nu:g}, outside -1 to 0.5", "a solid needs a ratio below 0.5 (rubber: 0.49)"
        )
    if all(given) and abs(E / (2 * (1 + nu) * G) - 1) > 0.01:
        raise card.error(f"E = {E:g}, G = {G:g} and NU = {nu:g} contradict E = 2 (1 + NU) G", "leave G blank")
    density = card.real(4, "the density", 0.0)
    if density < 0:
        raise card.error(f"the density is {density:g}, negative", "give a positive density")
    return Material(card.integer(0, "the material id"), E, nu, density)


def _mass_scale(cards: dict[str, list[Card]]) -> float:
    """PARAM WTMASS: the factor that turns the deck's weights into masses."""
    found = [card for card in cards.get("PARAM", []) if card.text(0).upper() == "WTMASS"]
    scale = found[-1].real(1, "the factor") if found else 1.0
    if scale <= 0:
        raise found[-1].error(f"the factor is {scale:g}, not positive")
    return scale


def _check_tie_ids(cards: dict[str, list[Card]]) -> None:
    _unique_ids([card for name in ("RBE2", "RBE3") for card in cards.get(name, [])], "rigid element")


def _count_ignored(deck: Deck, ignored: Counter[str]) -> None:
    for name, found in deck.cards.items():
        if name not in TAKEN:
            count = len(found) if name != "PARAM" else sum(card.text(0).upper() != "WTMASS" for card in found)
            if count:
                ignored[name] += count
    if deck.after_end:
        ignored["lines after ENDDATA"] += deck.after_end
