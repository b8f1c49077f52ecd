"""Grids as VTKHDF for ParaView and PyVista: arrays and attributes, to be written by the owner of the file.

Format: VTKHDF 2.2 UnstructuredGrid (docs.vtk.org, "VTKHDF format specification")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strainsight.mesh.facets import Facets, by_kind
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.model import CellBlock, FloatArray, IntArray
from strainsight.mesh.thin import BeamBlock, ShellBlock, concatenate

VTK_TYPE = {"vertex": 1, "line": 3, "beam": 3, "rod": 3, "beam3": 21} | {
    kind.name: kind.vtk for kind in (*FACETS, *ELEMENTS)
}
"""VTK's cell type numbers."""


@dataclass(frozen=True)
class VtkHdf:
    """Content of /VTKHDF: datasets path → array; attributes group path ("" is /VTKHDF itself) → name → value."""

    datasets: dict[str, NDArray[Any]]
    attributes: dict[str, dict[str, Any]]


def unstructured_grid(
    position: FloatArray,
    blocks: Sequence[CellBlock | ShellBlock | BeamBlock],
    point_data: Mapping[str, ArrayLike] | None = None,
    cell_data: Mapping[str, ArrayLike] | None = None,
    steps: ArrayLike | None = None,
) -> VtkHdf:
    """A grid with data on points and cells, and steps (times, or frequencies of mode shapes).

    position (n, 3) [m]; blocks in order are the m cells; data (n,) or (n, c), and (m,) or (m, c).
    steps (T,): data whose first axes are (T, n) or (T, m) change with the step, others do not. Steps are shown on the time
    axis of ParaView, so equal ones are separated by the smallest possible amount.
    Raises ValueError for data of another length."""
    points = np.asarray(position, dtype=np.float64).reshape(-1, 3)
    n, m = len(points), sum(len(block.nodes) for block in blocks)
    sizes = concatenate(np.full(len(b.nodes), b.nodes.shape[1]) for b in blocks)
    connectivity = concatenate(np.asarray(b.nodes).ravel() for b in blocks)
    types = np.concatenate([np.zeros(0, np.uint8), *(np.full(len(b.nodes), VTK_TYPE[b.kind]) for b in blocks)])
    datasets: dict[str, NDArray[Any]] = {
        "NumberOfPoints": np.array([n], dtype=np.int64),
        "NumberOfCells": np.array([m], dtype=np.int64),
        "NumberOfConnectivityIds": np.array([len(connectivity)], dtype=np.int64),
        "Points": points,
        "Types": types.astype(np.uint8),
        "Offsets": np.r_[0, np.cumsum(sizes)].astype(np.int64),
        "Connectivity": connectivity.astype(np.int64),
    }
    attributes: dict[str, dict[str, Any]] = {
        "": {"Version": np.array([2, 2], dtype=np.int64), "Type": np.bytes_("UnstructuredGrid")}
    }
    values = None if steps is None else np.asarray(steps, dtype=np.float64).ravel()
    if values is not None:
        datasets |= _steps(values)
        attributes["Steps"] = {"NSteps": np.int64(len(values))}
    for group, length, data in (("PointData", n, point_data or {}), ("CellData", m, cell_data or {})):
        for name, array in data.items():
            flat, offsets = _stepped(group, name, np.asarray(array), length, values)
            datasets[f"{group}/{name}"] = flat
            if offsets is not None:
                datasets[f"Steps/{group}Offsets/{name}"] = offsets
    return VtkHdf(datasets, attributes)


def facet_cells(facets: Facets) -> tuple[IntArray, tuple[CellBlock, ...], IntArray]:
    """A surface as a separate grid, without the points inside the solid.

    Returns the node numbers that occur (s,), ascending, to select point data; the facets as cells, kind by kind, with the ids of
    their elements, on points 0 … s − 1; and the order (f,) of the facets, to select cell data."""
    used = np.unique(facets.nodes[facets.nodes >= 0])
    order = np.argsort(facets.kind, kind="stable")
    blocks = []
    for kind, rows, nodes in by_kind(facets.kind, facets.nodes):
        local = np.searchsorted(used, nodes)
        blocks.append(CellBlock(kind.name, facets.element_id[rows], local, facets.region[rows]))
    return used, tuple(blocks), order


def _steps(values: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """One geometry for all steps: every offset is zero."""
    rising = values.copy()
    for i in range(1, len(rising)):
        rising[i] = max(rising[i], np.nextafter(rising[i - 1], np.inf))
    nothing = np.zeros(len(values), dtype=np.int64)
    return {
        "Steps/Values": rising,
        "Steps/PartOffsets": nothing,
        "Steps/NumberOfParts": nothing + 1,
        "Steps/PointOffsets": nothing,
        "Steps/CellOffsets": nothing[:, None],
        "Steps/ConnectivityIdOffsets": nothing[:, None],
    }


def _stepped(
    group: str, name: str, array: NDArray[Any], length: int, values: NDArray[np.float64] | None
) -> tuple[NDArray[Any], NDArray[np.int64] | None]:
    """Data with consecutive steps, as in the file, and the offset of each step."""
    if values is not None and array.ndim > 1 and array.shape[:2] == (len(values), length):
        return array.reshape(-1, *array.shape[2:]), np.arange(len(values), dtype=np.int64) * length
    if array.ndim == 0 or array.shape[0] != length:
        raise ValueError(
            f"{group} {name}: the array has the shape {array.shape}, but its shape must begin with {length}"
            + ("" if values is None else f" or ({len(values)}, {length})")
        )
    return array, None if values is None else np.zeros(len(values), dtype=np.int64)
