"""Abaqus and CalculiX decks: solids, materials, supports, ties and masses; the rest is counted, never dropped."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.decks.abaqus.assembly import assemble
from strainsight.decks.abaqus.cells import SOLIDS, USUAL
from strainsight.decks.abaqus.loads import loads_of
from strainsight.decks.abaqus.materials import regions_and_materials
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.springs import NODES as SPRINGS
from strainsight.decks.abaqus.springs import springs
from strainsight.decks.abaqus.supports import fixed_components, nodal_axes, point_masses
from strainsight.decks.abaqus.surfaces import Surface, cell_blocks, surfaces
from strainsight.decks.abaqus.text import Keyword, read_keywords
from strainsight.decks.abaqus.ties import Ties, ties
from strainsight.decks.effects import ENFORCED, effects, spelt
from strainsight.decks.faults import check_elements
from strainsight.decks.moments import turning_nodes
from strainsight.errors import DeckError
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import CellBlock, IntArray, Mesh, Origin

TAKEN = re.compile(
    r"NODE|ELEMENT|NSET|ELSET|SURFACE|(END)?(PART|ASSEMBLY|INSTANCE)|SYSTEM|TRANSFORM|MATERIAL|ELASTIC|DENSITY|"
    r"SOLIDSECTION|BOUNDARY|CLOAD|DLOAD|DSLOAD|SPRING|MASS|ROTARYINERTIA|RIGIDBODY|(KINEMATIC)?COUPLING|KINEMATIC|DISTRIBUTING|MPC|EQUATION"
)
HARMLESS = re.compile(
    r"HEADING|PREPRINT|(END)?STEP|RESTART|ORIENTATION|SECTIONCONTROLS|AMPLITUDE|TIMEPOINTS|(SOLVER)?CONTROLS|MONITOR|"
    r"PRINT|FILEFORMAT|FILEOUTPUT|(NODE|ELEMENT|CONTACT|ENERGY|MODAL|INTEGRATED)?OUTPUT|INTEGRATEDOUTPUTSECTION|"
    r"(NODE|EL|CONTACT|ENERGY|MODAL|SECTION)(FILE|PRINT)|PHYSICALCONSTANTS|DIAGNOSTICS|STATIC|(COMPLEX)?FREQUENCY|"
    r"(MODAL)?DYNAMIC|STEADYSTATEDYNAMICS|BUCKLE|VISCO|RANDOMRESPONSE|RESPONSESPECTRUM|HEATTRANSFER|DIRECTCYCLIC"
)
"""Output, procedures and their control: they change neither stiffness, mass, ties nor supports."""
STRUCTURAL = re.compile(
    r"\*(?!CLOAD|DLOAD|DSLOAD|DFLUX|CFLUX|FILM|TEMPERATURE|EXPANSION|CONDUCTIVITY|SPECIFIC HEAT|INITIAL|AMPLITUDE)"
)
UNSUPPORTED = re.compile(
    r"\*(ELEMENT,|TIE$|EQUATION$|MPC|CONTACT$|CONTACT ?PAIR|EMBEDDED ?ELEMENT|SHELL ?TO ?SOLID|NONSTRUCTURAL ?MASS|MATRIX"
    r"|SUBSTRUCTURE|SUBMODEL|FASTENER|CYCLIC ?SYMMETRY|PRE-TENSION|RELEASE|COUPLING|DISTRIBUTING ?COUPLING|RIGID ?BODY"
    r"|CLOAD|DLOAD|DSLOAD|TEMPERATURE|BASE ?MOTION|INERTIA ?RELIEF)"
)
"""Elements, ties and loads: what a model is not the same without."""
CONTROL = re.compile(r"\*(CLOAD|DLOAD|DSLOAD|TEMPERATURE|AMPLITUDE|INITIAL)")
ELEMENT = "*ELEMENT, TYPE="
REFUSED = {
    "PARAMETER": ("parameters are not supported", "write their values out"),
    "MANIFEST": ("assemblies of several files are not supported", "write the deck as one file"),
}


def read_abaqus(path: Path, *, required: bool = True, stated: bool = True, ignore: Sequence[str] = ()) -> Mesh:
    """An Abaqus or CalculiX input deck in its own units, with its own ids.

    Imported: *NODE, *ELEMENT (the types of `mesh.kinds`, MASS, ROTARYI, SPRING1, 2, A), *NSET, *ELSET,
    *SURFACE, *PART, *INSTANCE, *SYSTEM, *TRANSFORM, *MATERIAL (*ELASTIC, *DENSITY), *SOLID SECTION, *BOUNDARY,
    *CLOAD, *DLOAD, *DSLOAD, *SPRING, *MASS, *ROTARY INERTIA, *RIGID BODY, *COUPLING, *KINEMATIC COUPLING, *MPC (BEAM),
    *INCLUDE. What else changes the structure is in `ignored` with its count. Sets of a part are "INSTANCE.SET" where there
    are several instances.
    required: there have to be solids; stated: section and material of all of them; ignore: keywords and types of
    elements that are left out. Raises DeckError with file:line for what cannot be imported as it stands.
    """
    path = Path(path)
    keywords, included = read_keywords(path)
    for keyword in keywords:
        if keyword.name in REFUSED:
            raise keyword.error(*REFUSED[keyword.name])
    named = {spelt(name) for name in ignore}
    dropped = Counter(keyword.title for keyword in keywords if spelt(keyword.title) in named)
    keywords = [keyword for keyword in keywords if keyword.title not in dropped]
    assembly, out = _without(assemble(keywords), named)
    dropped += out
    _check_elements(assembly, path, required)
    ignored = _ignored(keywords, assembly) + dropped
    node_sets, element_sets, set_names = _sets(assembly)
    region, regions, materials = regions_and_materials(assembly, keywords, set_names, ignored, stated)
    blocks = cell_blocks(assembly, region)
    _check_connectivity(assembly, blocks)
    origin = {
        "node": _origin(assembly.node_ids, assembly.node_where),
        "element": _origin(assembly.element_ids, assembly.element_where),
    }
    bare = Mesh(assembly.node_ids, assembly.position, blocks, {}, {}, np.zeros((0, 2), dtype=np.int64), origin=origin)
    found = surfaces(assembly, bare, ignored)
    for surface in found.values():
        if surface.nodes.size:
            _add_set(node_sets, assembly, surface, assembly.node_ids[surface.nodes])
    axes = nodal_axes(assembly)
    made: Ties = ties(assembly, found, axes, ignored)
    origin["tie"] = _origin(np.arange(1, len(made.where) + 1), made.where)
    fixed, enforced = fixed_components(assembly, made.rotations, ignored)
    ignored.update({ENFORCED: len(enforced)} if enforced else {})
    loads = loads_of(assembly, found, axes, made.rotations, turning_nodes(made.rigid, made.averaging), ignored)
    masses = point_masses(assembly, made.rotations)
    return Mesh(
        node_ids=assembly.node_ids,
        position=assembly.position,
        blocks=blocks,
        regions=regions,
        materials=materials,
        fixed=fixed,
        rigid=tuple(made.rigid),
        averaging=tuple(made.averaging),
        point_masses=masses,
        springs=springs(assembly, axes, made.rotations),
        axes=axes,
        node_sets=node_sets,
        element_sets=element_sets,
        loads=loads,
        ignored=dict(sorted(ignored.items())),
        effect=effects(ignored, STRUCTURAL, CONTROL),
        unsupported={
            card: _first(card, keywords, assembly)
            for card in sorted(ignored)
            if UNSUPPORTED.match(card) and card not in dropped
        }
        | ({ENFORCED: enforced[0]} if enforced else {}),
        notes=(*_reinterpreted(assembly), *assembly.notes),
        source=str(path),
        included=included,
        origin=origin,
    )


def _without(assembly: Assembly, named: Collection[str]) -> tuple[Assembly, Counter[str]]:
    """The elements of these types are of none, so that nothing takes them; and how many there are of each."""
    out = np.array([spelt(type_) in named for type_ in assembly.type], dtype=bool)
    counted = Counter(f"{ELEMENT}{type_}" for type_, own in zip(assembly.type, out, strict=True) if own)
    types = ["" if own else type_ for type_, own in zip(assembly.type, out, strict=True)]
    return replace(assembly, type=types, kind=np.where(out, -1, assembly.kind)), counted


def _first(card: str, keywords: Sequence[Keyword], assembly: Assembly) -> str:
    """Where a keyword, or an element of a type, stands first."""
    if card.startswith(ELEMENT):
        file, line = assembly.element_where[assembly.type.index(card.removeprefix(ELEMENT))]
        return f"{file}:{line}"
    return next(keyword.where for keyword in keywords if card.startswith(keyword.title))


def _check_elements(assembly: Assembly, path: Path, required: bool) -> None:
    if not assembly.node_ids.size:
        raise DeckError("the deck holds no node", where=str(path), remedy="check that this is the deck of the model")
    if required and not np.any(assembly.kind >= 0):
        raise DeckError(
            "the deck holds no solid element",
            where=str(path),
            remedy=f"the model needs {FAMILIES} ({USUAL})",
        )


def _check_connectivity(assembly: Assembly, blocks: tuple[CellBlock, ...]) -> None:
    """No element with a node twice, no two elements on the same nodes."""
    row_of = {int(number): row for row, number in enumerate(assembly.element_ids)}

    def where(_: str, number: int) -> str:
        file, line = assembly.element_where[row_of[number]]
        return f"{file}:{line}"

    check_elements(blocks, where, lambda block, i: f"{assembly.type[row_of[int(block.ids[i])]]} {block.ids[i]}")


def _ignored(keywords: list[Keyword], assembly: Assembly) -> Counter[str]:
    """Keywords, and elements by type, that change the structure and are not supported."""
    counted = Counter(k.title for k in keywords if not TAKEN.fullmatch(k.name) and not HARMLESS.fullmatch(k.name))
    for keyword in keywords:
        if keyword.name == "EQUATION":
            counted["*EQUATION"] += _equations(keyword)
    for type_, count in Counter(assembly.type).items():
        if type_ not in SOLIDS and type_ not in ("", "MASS", "ROTARYI", *SPRINGS):
            counted[f"{ELEMENT}{type_}"] += count
    return counted


def _equations(keyword: Keyword) -> int:
    """Equations of an *EQUATION: a line with the number of terms, then lines of three entries a term."""
    rows = keyword.rows(needed=False)
    return max(sum(sum(map(bool, row.entries)) == 1 for row in rows), 1)


def _reinterpreted(assembly: Assembly) -> list[str]:
    return [
        f"{count} {type_} taken as {SOLIDS[type_][0].name} {SOLIDS[type_][1]}"
        for type_, count in sorted(Counter(assembly.type).items())
        if type_ in SOLIDS and SOLIDS[type_][1]
    ]


def _sets(assembly: Assembly) -> tuple[dict[str, IntArray], dict[str, IntArray], dict[tuple[str, str], str]]:
    """Node sets and element sets (of solids) by name, ids of the mesh; (instance, SET) → name of an element set."""
    nodes: dict[str, IntArray] = {}
    elements: dict[str, IntArray] = {}
    names: dict[tuple[str, str], str] = {}
    for scope in (assembly.scopes[""], *(scope for name, scope in assembly.scopes.items() if name)):
        for key, written in assembly.set_names("NODE", scope).items():
            rows = assembly.node_set(key, scope, scope.part.keywords[0])
            nodes[_qualified(written, scope, assembly, nodes)] = np.sort(assembly.node_ids[rows])
        for key, written in assembly.set_names("ELEMENT", scope).items():
            name = names[scope.name, key] = _qualified(written, scope, assembly, elements)
            rows = assembly.element_set(key, scope, scope.part.keywords[0])
            solid = rows[assembly.kind[rows] >= 0]
            if solid.size or not rows.size:
                elements[name] = np.sort(assembly.element_ids[solid])
    return nodes, elements, names


def _qualified(written: str, scope: Scope, assembly: Assembly, taken: dict[str, IntArray]) -> str:
    clash = written.upper() in {name.upper() for name in taken}
    return f"{scope.name}.{written}" if scope.name and (not assembly.flat or clash) else written


def _add_set(node_sets: dict[str, IntArray], assembly: Assembly, surface: Surface, ids: IntArray) -> None:
    """A surface as a node set; its name says so where a node set has the same one."""
    name = _qualified(surface.name, surface.scope, assembly, {})
    if name.upper() in {other.upper() for other in node_sets}:
        name = f"{name} (surface)"
    node_sets[name] = np.sort(ids)


def _origin(ids: IntArray, where: list[tuple[str, int]]) -> Origin:
    files = tuple(dict.fromkeys(file for file, _ in where))
    index = {file: i for i, file in enumerate(files)}
    lines = np.array([line for _, line in where], dtype=np.int64)
    return Origin(ids, lines, np.array([index[file] for file, _ in where], dtype=np.int64), files)
