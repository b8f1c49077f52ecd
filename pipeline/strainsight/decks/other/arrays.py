"""What data on points and cells may mean: numbers of nodes and elements, regions, sets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray

REGIONS = (
    "region",
    "region_id",
    "gmsh:physical",
    "medit:ref",
    "cell_tags",
    "netgen:index",
    "tetgen:ref",
    "avsucd:material",
    "su2:tag",
    "ugrid:ref",
    "MaterialIds",
    "MaterialID",
    "MaterialId",
    "material_id",
    "material",
    "PartId",
    "part_id",
    "PropertyId",
    "property_id",
    "ElementBlockIds",
    "ObjectId",
)
"""Names under which programs write the region of a cell, the first that is there counts."""


class Labels(NamedTuple):
    """Cell data taken as regions: its name, values (cells,)."""

    name: str
    values: IntArray


def whole(values: Any) -> IntArray | None:
    """One whole number a row, (n,); None for anything else."""
    array = np.asarray(values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "biuf":
        return None
    if array.dtype.kind == "f" and not (np.all(np.abs(array) < 2.0**53) and np.all(array == np.floor(array))):
        return None
    return array.astype(np.int64)


def switches(values: Any) -> np.ndarray | None:
    """Which rows are on, for data that are 0 or 1 everywhere and 1 somewhere; None for other data."""
    numbers = whole(values)
    if numbers is None or not numbers.any() or not np.all((numbers == 0) | (numbers == 1)):
        return None
    return numbers == 1


def numbers_of(
    data: Mapping[str, Any], names: tuple[str, ...], count: int, what: str, notes: list[str]
) -> tuple[IntArray, str]:
    """Numbers of the nodes or elements (count,), and the data they come from, "" where they just count from 1."""
    for name in (name for name in names if name in data):
        numbers = whole(data[name])
        right = numbers is not None and len(numbers) == count and numbers.min(initial=1) > 0
        if numbers is not None and right and len(np.unique(numbers)) == count:
            return numbers, name
        notes.append(f"{what} data {name} are not positive and unique: they are no numbers of {what}s")
    notes.append(f"the file does not number its {what}s: they count from 1 in its order")
    return np.arange(1, count + 1), ""


def labels(data: Mapping[str, Any], name: str | None, count: int, path: str, notes: list[str]) -> Labels | None:
    """The cell data that say the regions: those of this name, or the first usual ones; None where there are none.

    Raises DeckError for a name that is not there or no whole numbers.
    """
    there = {
        key: numbers for key, values in data.items() if (numbers := whole(values)) is not None and len(numbers) == count
    }
    if name is not None:
        if name not in there:
            known = ", ".join(there) or "none"
            raise DeckError(
                f"cell data {name!r} are not whole numbers" if name in data else f"there are no cell data {name!r}",
                where=path,
                remedy=f"cell data that can be regions: {known}",
            )
        return Labels(name, there[name])
    for usual in REGIONS:
        if usual in there:
            notes.append(f"regions are the cell data {usual}")
            return Labels(usual, there[usual])
    others = ", ".join(there)
    notes.append(
        "no cell data say the regions: all elements are region 1 (solids)"
        + (f"; whole numbers are in {others}, to be named as region_data" if others else "")
    )
    return None
