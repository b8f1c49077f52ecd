"""A VTKHDF grid as the /VTKHDF group of an artefact, which ParaView opens directly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.mesh.model import CellBlock
from strainsight.mesh.vtkhdf import VtkHdf, unstructured_grid
from strainsight.workflow.output import Dataset


def vtkhdf_datasets(grid: VtkHdf) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Datasets and attributes of a grid, under the paths that the file format prescribes."""
    datasets = {f"/VTKHDF/{path}": Dataset(array, "", "") for path, array in grid.datasets.items()}
    attributes = {f"/VTKHDF/{path}".rstrip("/"): dict(values) for path, values in grid.attributes.items()}
    return datasets, attributes


def gauge_grid(
    position: np.ndarray, data: Mapping[str, np.ndarray]
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Gauges as a cloud of points (m, 3) [m] with data (m, ...) on each."""
    index = np.arange(len(position))
    return vtkhdf_datasets(
        unstructured_grid(position, (CellBlock("vertex", index, index[:, None], index),), point_data=data)
    )
