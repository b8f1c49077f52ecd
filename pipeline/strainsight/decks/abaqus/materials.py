"""Materials and solid sections of an Abaqus deck: the region of every element."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.faults import OR_CONFIG, elastic_fault
from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray, Material, Region


@dataclass
class Definition:
    """A *MATERIAL and its *ELASTIC, *DENSITY and other options."""

    keyword: Keyword
    options: dict[str, Keyword] = field(default_factory=dict)


def regions_and_materials(
    assembly: Assembly,
    keywords: list[Keyword],
    set_name: dict[tuple[str, str], str],
    ignored: Counter[str],
    stated: bool,
) -> tuple[IntArray, dict[int, Region], dict[int, Material]]:
    """Region of each element (m,), 0 for those that are no solids; the regions, one a *SOLID SECTION; their materials.

    set_name: (instance, SET) → its name in the mesh; stated: every solid has to have a section and its material; otherwise a
    region may have none, and elements without section are one. Raises DeckError for an element without section or with two, for a
    section without material or set, and for a material of a section that is not linear, isotropic and elastic.
    """
    definitions = _definitions(keywords)
    region = np.zeros(len(assembly.element_ids), dtype=np.int64)
    regions: dict[int, Region] = {}
    materials: dict[int, Material] = {}
    numbers: dict[str, int] = {}
    for scope, keyword in assembly.keywords("SOLIDSECTION"):
        rows = assembly.element_set(keyword.needs("ELSET"), scope, keyword)
        solid = rows[assembly.kind[rows] >= 0]
        if rows.size and not solid.size:
            continue
        if "COMPOSITE" in keyword.parameters:
            raise keyword.error("composite solids are not supported", "give the section one isotropic material")
        name = keyword.needs("MATERIAL").upper()
        if name not in definitions and stated:
            raise keyword.error(
                f"material {keyword.parameters['MATERIAL']!r} is not in the deck",
                f"add the *MATERIAL, or correct the name{OR_CONFIG}",
            )
        known = name in definitions and (stated or "ELASTIC" in definitions[name].options)
        if known and name not in numbers:
            numbers[name] = len(numbers) + 1
            materials[numbers[name]] = _material(definitions[name], numbers[name], assembly.notes)
        if (taken := solid[region[solid] > 0]).size:
            row = int(taken[0])
            raise keyword.error(
                f"element {assembly.element_ids[row]} is in the section of {regions[int(region[row])].name} already",
                "let every element belong to one section",
            )
        number = len(regions) + 1
        regions[number] = Region(number, _region_name(assembly, keyword, scope, set_name), numbers.get(name, 0))
        region[solid] = number
    without = np.flatnonzero((assembly.kind >= 0) & (region == 0))
    if without.size and not stated:
        number = len(regions) + 1
        regions[number] = Region(number, "without section", 0)
        region[without] = number
    elif without.size:
        row = int(without[0])
        file, line = assembly.element_where[row]
        raise DeckError(
            f"{assembly.type[row]} {assembly.element_ids[row]} has no section ({without.size} elements)",
            where=f"{file}:{line}",
            remedy=f"add a *SOLID SECTION with its element set and a material{OR_CONFIG}",
        )
    if unused := len(definitions) - len(numbers):
        ignored["*MATERIAL that no solid section refers to"] += unused
    return region, regions, materials


def _region_name(assembly: Assembly, keyword: Keyword, scope: Scope, set_name: dict[tuple[str, str], str]) -> str:
    within, written = assembly.split_name(keyword.parameters["ELSET"], scope)
    return set_name.get((within.name, written.upper()), written)


def _definitions(keywords: list[Keyword]) -> dict[str, Definition]:
    """NAME → material; its options are what follows until the next *MATERIAL."""
    found: dict[str, Definition] = {}
    current: Definition | None = None
    for keyword in keywords:
        if keyword.name == "MATERIAL":
            name = keyword.needs("NAME").upper()
            if name in found:
                raise keyword.error(
                    f"{keyword.parameters['NAME']!r} stands twice (first at {found[name].keyword.where})",
                    "give every material its own name",
                )
            current = found[name] = Definition(keyword)
        elif keyword.name in ("ELASTIC", "DENSITY"):
            if current is None:
                raise keyword.error("stands before any *MATERIAL", "put it after its *MATERIAL")
            if keyword.name in current.options:
                raise keyword.error(
                    f"stands twice in the material (first at {current.options[keyword.name].where})",
                    "remove one of them",
                )
            current.options[keyword.name] = keyword
    return found


def _material(definition: Definition, number: int, notes: list[str]) -> Material:
    name = definition.keyword.parameters["NAME"]
    elastic, density = definition.options.get("ELASTIC"), definition.options.get("DENSITY")
    if elastic is None:
        raise definition.keyword.error(
            f"material {name!r} of a solid section has no *ELASTIC",
            f"give its Young's modulus and Poisson's ratio{OR_CONFIG}",
        )
    if (kind := elastic.parameters.get("TYPE", "ISO").upper()) not in ("ISO", "ISOTROPIC"):
        raise elastic.error(f"TYPE={kind}: only isotropic solids are supported", "give the material TYPE=ISO")
    row = elastic.rows()[0]
    E, nu = row.real(0, "Young's modulus"), row.real(1, "Poisson's ratio", 0.0)
    if fault := elastic_fault(E, nu):
        raise row.error(*fault)
    rho = 0.0
    if density is None:
        notes.append(f"material {name} has no *DENSITY: taken as 0")
    else:
        row = density.rows()[0]
        rho = row.real(0, "the density")
        if rho < 0:
            raise row.error(f"the density is {rho:g}, negative", "give a positive density")
    for keyword in (elastic, density):
        if keyword is not None and len(keyword.texts) > 1:
            notes.append(
                f"material {name}: the first of {len(keyword.texts)} lines of {keyword.title} counts, whatever the temperature"
            )
    return Material(number, E, nu, rho, f"material {name}")
