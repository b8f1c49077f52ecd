"""A VTKHDF grid as the /VTKHDF group of an artefact, which ParaView opens directly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.mesh.model import CellBlock
from strainsight.mesh.vtkhdf import VtkHdf, unstructured_grid
from strainsight.runner.output import Dataset

STRAIN = "m/m"
UNITS = {
    "displacement": "m",
    "motion": "m",
    "strain": STRAIN,
    "strain_std": STRAIN,
    "stress": "Pa",
    "von_mises": "Pa",
    "von_mises_std": "Pa",
    "principal": "Pa",
    "equivalent_range": "Pa",
    "equivalent_range_of_mean": "Pa",
}
"""Of data on points or cells, by their name in every grid; of other names there is none."""


def vtkhdf_datasets(
    grid: VtkHdf, units: Mapping[str, str] = UNITS
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Datasets and attributes of a grid, under the paths that the file format prescribes; units: name of data → its unit."""
    datasets = {f"/VTKHDF/{path}": Dataset(array, "", "") for path, array in grid.datasets.items()}
    attributes = {f"/VTKHDF/{path}".rstrip("/"): dict(values) for path, values in grid.attributes.items()}
    for path in grid.datasets:
        where, _, name = path.partition("/")
        if where in ("PointData", "CellData") and name in units:
            attributes[f"/VTKHDF/{path}"] = {"units": units[name]}
    return datasets, attributes


def gauge_grid(
    position: np.ndarray, data: Mapping[str, np.ndarray], units: Mapping[str, str] = UNITS
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Gauges as a cloud of points (m, 3) [m] with data (m, ...) on each; units as in `vtkhdf_datasets`."""
    index = np.arange(len(position))
    return vtkhdf_datasets(
        unstructured_grid(position, (CellBlock("vertex", index, index[:, None], index),), point_data=data), units
    )
