"""Which regions of a file have the sections that are given beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.given_sections import GivenSection
from strainsight.mesh.model import Region

Groups = Mapping[int, Mapping[int | None, str]]
"""Dimension 1, 2, 3 → number of the region of its elements in the file (None: in no region) → name."""
Chosen = dict[tuple[int, int | None], tuple[Region, GivenSection]]
"""Dimension and number in the file → the region that these elements become, and its section."""

WORDS = {1: "lines", 2: "triangles and quadrangles", 3: "solids"}
INSTEAD = {1: "lines have an area", 2: "triangles and quadrangles have a thickness", 3: "solids have no section"}
SHELLS = (
    "triangles and quadrangles become shells, and lines beams, where mesh.sections gives their regions a section: "
    "{skin: {regions: all, thickness: …}}"
)
"""What a file without solids may do."""


def regions_with_sections(
    groups: Groups, given: Mapping[str, GivenSection], solids: Mapping[int, Region], notes: list[str]
) -> Chosen:
    """The regions of triangles, quadrangles and lines that have a section; given: key of the config → section.

    A region keeps its number unless one of another dimension has it, and its name, with its dimension as in "skin (2d)" where
    another has that. Raises UserError with the key for a region that has no such elements, or two sections.
    """
    taken: dict[tuple[int, int | None], str] = {}
    for key, own in given.items():
        for tag in _tags(key, own, groups):
            if (other := taken.setdefault((own.dimension, tag), key)) != key:
                name = groups[own.dimension][tag]
                raise UserError(
                    f"region {name} has the section {other.rpartition('.')[2]} already",
                    key=f"{key}.regions",
                    remedy="give a region one section",
                )
    known = [tag for own in groups.values() for tag in own if tag is not None]
    spare = max([0, *known, *solids]) + 1
    chosen: Chosen = {}
    regions = dict(solids)
    for (dimension, tag), key in sorted(
        taken.items(), key=lambda item: (-item[0][0], item[0][1] is None, item[0][1] or 0)
    ):
        name = groups[dimension][tag]
        if name in {own.name for own in regions.values()}:
            name = f"{name} ({dimension}d)"
        number = tag
        if number is None or number in regions:
            number, spare = spare, spare + 1
        if tag is not None and number != tag:
            notes.append(
                f"region {tag} of {WORDS[dimension]} is region {number} ({name}), as {regions[tag]} is another"
            )
        regions[number] = Region(number, name, 0)
        chosen[dimension, tag] = (regions[number], given[key])
    return chosen


def sections_by_region(chosen: Chosen) -> dict[int, GivenSection]:
    """Region id → its section."""
    return {region.id: own for region, own in chosen.values()}


def _tags(key: str, own: GivenSection, groups: Groups) -> Iterator[int | None]:
    """Numbers in the file of the regions of a section."""
    there = groups.get(own.dimension, {})
    words = WORDS[own.dimension]
    if own.regions is None and not there:
        raise UserError(f"the file has no {words}", key=f"{key}.regions", remedy="remove the section")
    if own.regions is None:
        yield from there
        return
    for entry in own.regions:
        found = _named(entry, there)
        if not found:
            others = [d for d in (3, 2, 1) if _named(entry, groups.get(d, {}))]
            names = [str(name) for tag, name in there.items() if tag is not None]
            raise UserError(
                f"region {entry!r} has {WORDS[others[0]]} and no {words}"
                if others
                else f"the file has no region {entry!r} of {words}",
                key=f"{key}.regions",
                remedy=INSTEAD[others[0]]
                if others
                else did_you_mean(str(entry), names, f"its regions of {words}: {', '.join(names) or 'none'}; or all"),
            )
        yield from found


def _named(entry: int | str, there: Mapping[int | None, str]) -> list[int | None]:
    return [tag for tag, name in there.items() if tag is not None and entry in (tag, name)]
