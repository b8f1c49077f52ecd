"""Abaqus and CalculiX decks: solids, shells, beams, supports, ties and masses; everything else is counted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.decks.abaqus.contact import Contact, with_contact
from strainsight.decks.abaqus.history import LARGE, STRESSED, preloads, state_of
from strainsight.decks.abaqus.loads import LoadReader
from strainsight.decks.abaqus.materials import by_temperature
from strainsight.decks.abaqus.parts import SOLIDS, THIN, USUAL
from strainsight.decks.abaqus.scopes import Assembly, Scope, assemble
from strainsight.decks.abaqus.sections import beam_blocks, read_sections, shell_blocks
from strainsight.decks.abaqus.supports import NODES as SPRINGS
from strainsight.decks.abaqus.supports import equations, nodal_axes, point_masses, springs
from strainsight.decks.abaqus.surfaces import Surfaces, cell_blocks, surfaces
from strainsight.decks.abaqus.text import Keyword, read_keywords, split
from strainsight.decks.abaqus.ties import ties, with_tied_surfaces, with_whole_ring
from strainsight.decks.faults import (
    ENFORCED,
    HELD,
    check_elements,
    classify_effects,
    notes_and_doubts,
    spelt,
    turning_nodes,
)
from strainsight.decks.text import error_at
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import CellBlock, IntArray, Mesh, Origin
from strainsight.mesh.surface_ties import without_held
from strainsight.mesh.thin import nodes_that_turn

IMPORTED = re.compile(
    r"NODE|ELEMENT|NSET|ELSET|SURFACE|(END)?(PART|ASSEMBLY|INSTANCE)|SYSTEM|TRANSFORM|MATERIAL|ELASTIC|DENSITY|"
    r"(SOLID|SHELL|SHELLGENERAL|BEAM|BEAMGENERAL)SECTION|BOUNDARY|CLOAD|DLOAD|DSLOAD|SPRING|MASS|ROTARYINERTIA|RIGIDBODY|(KINEMATIC)?COUPLING|KINEMATIC|DISTRIBUTING|MPC|EQUATION|TIE|CONTACTPAIR|MODELCHANGE|CYCLICSYMMETRYMODEL"
)
HARMLESS = re.compile(
    r"HEADING|PREPRINT|SECTIONPOINTS|(END)?STEP|RESTART|ORIENTATION|SECTIONCONTROLS|AMPLITUDE|TIMEPOINTS|(SOLVER)?CONTROLS|MONITOR|"
    r"PRINT|FILEFORMAT|FILEOUTPUT|(NODE|ELEMENT|CONTACT|ENERGY|MODAL|INTEGRATED)?OUTPUT|INTEGRATEDOUTPUTSECTION|"
    r"(NODE|EL|CONTACT|ENERGY|MODAL|SECTION)(FILE|PRINT)|PHYSICALCONSTANTS|DIAGNOSTICS|STATIC|(COMPLEX)?FREQUENCY|"
    r"(MODAL)?DYNAMIC|STEADYSTATEDYNAMICS|BUCKLE|VISCO|RANDOMRESPONSE|RESPONSESPECTRUM|HEATTRANSFER|DIRECTCYCLIC|SELECTCYCLICSYMMETRYMODES|GREEN"
)
"""Output, procedures and their control, which change neither stiffness, mass, ties nor supports."""
STRUCTURAL = re.compile(
    r"\*(?!CLOAD|DLOAD|DSLOAD|DFLUX|CFLUX|FILM|RADIATE|TEMPERATURE|BASE ?MOTION|EXPANSION|CONDUCTIVITY|SPECIFIC HEAT"
    r"|INITIAL|AMPLITUDE)"
)
UNSUPPORTED = re.compile(
    r"\*(ELEMENT,|TIE( that|$)|MPC|CONTACT$|EMBEDDED ?ELEMENT|SHELL ?TO ?SOLID|NONSTRUCTURAL ?MASS|MATRIX"
    r"|SUBSTRUCTURE|SUBMODEL|FASTENER|PRE-TENSION|RELEASE|COUPLING|DISTRIBUTING ?COUPLING|RIGID ?BODY"
    r"|CLOAD|DLOAD|DSLOAD|INERTIA ?RELIEF)"
)
"""Elements, ties and loads without which the model is wrong."""
OF_THIN = re.compile(
    r"\*(NORMAL$|NODE with|TRANSVERSE ?SHEAR|CENTROID|SHEAR ?CENTER|BEAM ?ADDED ?INERTIA|BEAM ?FLUID ?INERTIA"
    r"|BEAM ?SECTION ?OFFSET)"
)
"""Keywords without which shells and beams are wrong."""
BEFORE = "lines before the first keyword"
OF_CONTACT = re.compile(
    r"\*(SURFACE ?INTERACTION|SURFACE ?BEHAVIOR|FRICTION|CONTACT ?(DAMPING|INTERFERENCE|FILE|CONTROLS)|CLEARANCE"
    r"|CHANGE ?(FRICTION|CONTACT ?TYPE|SURFACE ?BEHAVIOR)|GAP ?(CONDUCTANCE|HEAT ?GENERATION))"
)
"""Behaviour of contact pairs, which has no effect on bonded or open pairs."""
CONTROL = re.compile(rf"\*(CLOAD|DLOAD|DSLOAD|TEMPERATURE|BASE ?MOTION|AMPLITUDE|INITIAL)|{BEFORE}")
ELEMENT = "*ELEMENT, TYPE="
REFUSED = {
    "PARAMETER": ("named variables are not supported", "write a number instead of each <name>, and remove *PARAMETER"),
    "MANIFEST": ("an assembly of several decks (*MANIFEST) is not supported", "export the complete model as one deck"),
}


def read_abaqus(
    path: Path,
    *,
    required: bool = True,
    materials_required: bool = True,
    ignore: Sequence[str] = (),
    include: Sequence[Path] = (),
    contact: Contact | None = None,
    step: int | None = None,
) -> Mesh:
    """Read an Abaqus or CalculiX input deck with its units and ids.

    Imported: *NODE, *ELEMENT (the types of `mesh.kinds` and of `cells.THIN`, MASS, ROTARYI, SPRING1, 2, A), *NSET, *ELSET,
    *SURFACE, *PART, *INSTANCE, *SYSTEM, *TRANSFORM, *MATERIAL (*ELASTIC, *DENSITY), the sections of `sections`, *BOUNDARY,
    *CLOAD, *DLOAD, *DSLOAD, *SPRING, *MASS, *ROTARY INERTIA, *RIGID BODY, *COUPLING, *KINEMATIC COUPLING, *MPC (BEAM),
    *EQUATION, *TIE of surfaces, *CONTACT PAIR, *INCLUDE. Everything else that changes the structure is counted in `ignored`.
    Sets of a part are "INSTANCE.SET" if there are several instances. required: require elements, and sections of shells and
    beams; materials_required: require section and material of all elements; ignore: keywords and element types to leave out;
    include: further folders of included files; contact: treatment of *CONTACT PAIR, see `with_contact`; step: step that defines
    supports and elements, see `state_of`. Raises DeckError with file:line for unsupported input."""
    path = Path(path)
    keywords, included, before, of_files = read_keywords(path, include)
    for keyword in keywords:
        if keyword.name in REFUSED:
            raise keyword.error(*REFUSED[keyword.name])
    named = {spelt(name) for name in ignore}
    dropped = Counter(keyword.title for keyword in keywords if spelt(keyword.title) in named)
    keywords = [keyword for keyword in keywords if keyword.title not in dropped]
    assembly = assemble(keywords)
    of_supports: Counter[str] = Counter()
    state = state_of(assembly, of_supports, step)
    assembly, out = _remove_elements(assembly, named, state.elements)
    dropped += out
    _check_elements(assembly, path, required)
    loaded = preloads(assembly.steps)
    ignored = _count_ignored(keywords, assembly) + dropped + Counter({BEFORE: before} if before else {})
    ignored += of_supports
    ignored.update({card: len(steps) for card, steps in loaded.items()})
    node_sets, element_sets, set_names = _sets(assembly)
    sections = read_sections(assembly, keywords, set_names, ignored, required, materials_required)
    if (left := assembly.element_ids[sections.left]).size:
        element_sets = {name: np.setdiff1d(ids, left) for name, ids in element_sets.items()}
    blocks = cell_blocks(assembly, sections.region)
    _check_connectivity(assembly, blocks)
    shells, beams = shell_blocks(assembly, sections), beam_blocks(assembly, sections)
    if (shells or beams) and (count := _nodes_with_normals(keywords)):
        ignored["*NODE with a normal"] = count
    origin = {
        "node": Origin.at(assembly.node_ids, assembly.node_where),
        "element": Origin.at(assembly.element_ids, assembly.element_where),
    }
    bare = Mesh(assembly.node_ids, assembly.position, blocks, origin=origin)
    deck_surfaces = surfaces(assembly, bare, ignored)
    node_sets |= _surface_sets(deck_surfaces, node_sets)
    axes = nodal_axes(assembly)
    deck_ties = ties(deck_surfaces, axes, ignored)
    origin["tie"] = Origin.at(np.arange(1, len(deck_ties.where) + 1), deck_ties.where)
    fixed = state.supports.pairs(deck_ties.rotations, ignored, free=spelt(ENFORCED) in named)
    turned = set(nodes_that_turn(shells, beams).tolist())
    still = set(bare.nodes_of_elements.tolist()) - turned - turning_nodes(deck_ties.rigid, deck_ties.averaging)
    related = equations(assembly, deck_ties.rotations, still)
    origin["relation"] = Origin.at(np.arange(1, len(related.where) + 1), related.where)
    turning = turning_nodes(deck_ties.rigid, deck_ties.averaging, related.relations) | turned
    mesh = Mesh(
        **vars(sections.properties),
        node_ids=assembly.node_ids,
        position=assembly.position,
        blocks=blocks,
        fixed=fixed,
        rigid=tuple(deck_ties.rigid),
        averaging=tuple(deck_ties.averaging),
        relations=tuple(related.relations),
        point_masses=point_masses(assembly, deck_ties.rotations),
        springs=springs(assembly, axes, deck_ties.rotations),
        shells=shells,
        beams=beams,
        axes=axes,
        node_sets=node_sets,
        element_sets=element_sets,
        loads=LoadReader(deck_surfaces, axes, deck_ties.rotations, sections, ignored).read(turning),
        source=str(path),
        included=included,
        origin=origin,
    )
    mesh, deck_surfaces = with_whole_ring(mesh, deck_surfaces)
    mesh, refused = with_tied_surfaces(mesh, deck_surfaces)
    mesh = without_held(with_contact(mesh, deck_surfaces, keywords, contact, state.pairs))
    control = dict.fromkeys(filter(OF_CONTACT.match, ignored), "none") if mesh.contacts else {}
    for card, where in refused.items():
        if spelt(card) in named:
            dropped[card] = len(where)
        ignored[card] = len(where)
    notes, doubts = notes_and_doubts([*of_files, *_note_reinterpreted(assembly), *assembly.notes, *mesh.notes])
    return replace(
        mesh,
        ignored=dict(sorted(ignored.items())),
        effect=classify_effects(ignored, STRUCTURAL, CONTROL)
        | control
        | {card: "structure" for card in ignored if card in (ENFORCED, HELD, STRESSED) or card in loaded},
        unsupported={
            card: refused[card][0] if card in refused else _first(card, keywords, assembly)
            for card in sorted(ignored)
            if card not in dropped
            and (
                UNSUPPORTED.match(card)
                or ((shells or beams) and OF_THIN.match(card))
                or (card == "*TEMPERATURE" and by_temperature(keywords))
            )
        }
        | {card: steps[0].where for card, steps in loaded.items() if card != LARGE},
        notes=notes,
        doubts=doubts,
        read=_read(keywords, assembly, ignored),
    )


def _remove_elements(
    assembly: Assembly, named: Collection[str], removed: Collection[int]
) -> tuple[Assembly, Counter[str]]:
    """Assembly with elements of these types and rows removed (their type is empty), and the number removed by type."""
    out = np.array([spelt(type_) in named for type_ in assembly.type], dtype=bool)
    counted = Counter(f"{ELEMENT}{type_}" for type_, is_out in zip(assembly.type, out, strict=True) if is_out)
    out[list(removed)] = True
    types = ["" if is_out else type_ for type_, is_out in zip(assembly.type, out, strict=True)]
    return replace(assembly, type=types, kind=np.where(out, -1, assembly.kind)), counted


def _first(card: str, keywords: Sequence[Keyword], assembly: Assembly) -> str:
    """First place of a keyword, or of an element of a type."""
    if card.startswith(ELEMENT):
        return assembly.where(assembly.type.index(card.removeprefix(ELEMENT)))
    return next(keyword.where for keyword in keywords if card.startswith(keyword.title))


def _check_elements(assembly: Assembly, path: Path, required: bool) -> None:
    if not assembly.node_ids.size:
        raise error_at(path, "the deck contains no nodes", "check that the file is the input deck of the model")
    if required and not np.any(assembly.families != ""):
        raise error_at(
            path,
            "the deck contains no solid, shell or beam elements",
            f"add elements of these types: {FAMILIES} ({USUAL}), {', '.join(THIN)}",
        )


def _check_connectivity(assembly: Assembly, blocks: tuple[CellBlock, ...]) -> None:
    """Raise DeckError for an element with a repeated node, or two elements with the same nodes."""
    row_of = {int(number): row for row, number in enumerate(assembly.element_ids)}
    check_elements(
        blocks,
        lambda _, number: assembly.where(row_of[number]),
        lambda block, i: assembly.element(row_of[int(block.ids[i])]),
    )


def _count_ignored(keywords: list[Keyword], assembly: Assembly) -> Counter[str]:
    """Count keywords, and elements by type, that change the structure and are not supported."""
    counted = Counter(k.title for k in keywords if not IMPORTED.fullmatch(k.name) and not HARMLESS.fullmatch(k.name))
    stress = [k.title for k in keywords if k.name == "INITIALCONDITIONS" and k.word("TYPE") == "STRESS"]
    if stress:
        counted[STRESSED] = len(stress)
        counted -= Counter(stress)
    for type_, count in Counter(assembly.type).items():
        if type_ not in SOLIDS and type_ not in THIN and type_ not in ("", "MASS", "ROTARYI", *SPRINGS):
            counted[f"{ELEMENT}{type_}"] += count
    return counted


def _read(keywords: Sequence[Keyword], assembly: Assembly, ignored: Collection[str]) -> dict[str, int]:
    """Imported keywords and element types → count."""
    counts = Counter(k.title for k in keywords if IMPORTED.fullmatch(k.name) and k.title not in ignored)
    types = Counter(f"{ELEMENT}{type_}" for type_ in assembly.type if type_)
    return dict(counts + Counter({name: count for name, count in types.items() if name not in ignored}))


def _nodes_with_normals(keywords: Sequence[Keyword]) -> int:
    """Number of nodes with a normal after their coordinates, which is that of shells and n2 of beams."""
    texts = (text for keyword in keywords if keyword.name == "NODE" for text in keyword.texts if text.count(",") > 3)
    return sum(any(split(text)[4:7]) for text in texts)


def _note_reinterpreted(assembly: Assembly) -> list[str]:
    how = {type_: (kind.name, note) for type_, (kind, note) in SOLIDS.items()} | THIN
    return [
        f"{count} {type_} element{'s' * (count > 1)} imported as {kind}: {note}"
        for type_, count in sorted(Counter(assembly.type).items())
        for kind, note in [how.get(type_, ("", ""))]
        if note
    ]


def _sets(assembly: Assembly) -> tuple[dict[str, IntArray], dict[str, IntArray], dict[tuple[str, str], str]]:
    """Node sets and element sets (imported elements only) by name, with ids of the mesh; (instance, SET) → name of
    an element set."""
    nodes: dict[str, IntArray] = {}
    elements: dict[str, IntArray] = {}
    names: dict[tuple[str, str], str] = {}
    used: tuple[set[str], set[str]] = (set(), set())
    family = assembly.families
    for scope in (assembly.scopes[""], *(scope for name, scope in assembly.scopes.items() if name)):
        for key, written in assembly.set_names("NODE", scope).items():
            rows = assembly.set_rows("NODE", key, scope, scope.part.keywords[0])
            nodes[_qualified_name(written, scope, assembly, used[0])] = np.sort(assembly.node_ids[rows])
        for key, written in assembly.set_names("ELEMENT", scope).items():
            name = names[scope.name, key] = _qualified_name(written, scope, assembly, used[1])
            rows = assembly.set_rows("ELEMENT", key, scope, scope.part.keywords[0])
            known = rows[family[rows] != ""]
            if known.size or not rows.size:
                elements[name] = np.sort(assembly.element_ids[known])
    return nodes, elements, names


def _qualified_name(written: str, scope: Scope, assembly: Assembly, used: set[str]) -> str:
    """Name of a set, which is added in capitals to the used names."""
    clash = written.upper() in used
    name = f"{scope.name}.{written}" if scope.name and (not assembly.flat or clash) else written
    used.add(name.upper())
    return name


def _surface_sets(surfaces: Surfaces, node_sets: dict[str, IntArray]) -> dict[str, IntArray]:
    """Surfaces as node sets; the name gets the suffix "(surface)" if a node set has the same name."""
    assembly, used, sets = surfaces.assembly, {name.upper() for name in node_sets}, {}
    for surface in surfaces.by_name.values():
        if surface.nodes.size:
            name = _qualified_name(surface.name, surface.scope, assembly, set())
            name = f"{name} (surface)" if name.upper() in used else name
            used.add(name.upper())
            sets[name] = np.sort(assembly.node_ids[surface.nodes])
    return sets
