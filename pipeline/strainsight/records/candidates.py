"""Candidate gauges in a file: `Candidates` by columns, strain rows that a table gave."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from scipy import sparse

from strainsight.gauges.candidates import Candidates
from strainsight.records.record import dataset, record


@record
class CandidateColumns:
    """`Candidates`, a row a channel."""

    element: np.ndarray = dataset("/element", "1", "channel", "element id of every candidate")
    facet: np.ndarray = dataset(
        "/facet", "1", "channel", "facet number within the element, from 1, in the order of this page"
    )
    kind: np.ndarray = dataset("/kind", "1", "channel", "kind of the facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8")
    nodes: np.ndarray = dataset("/nodes", "1", "channel × 8", "node indices of the facet, −1 where it has fewer")
    position: np.ndarray = dataset("/position", "m", "channel × 3", "where it sits, of a candidate the facet's centre")
    normal: np.ndarray = dataset("/normal", "1", "channel × 3", "outward normal")
    direction: np.ndarray = dataset(
        "/direction", "1", "channel × 3", "measuring direction, of strain in the facet's plane"
    )
    angle: np.ndarray = dataset(
        "/angle", "deg", "channel", "from the projected axis, right-handed about the outward normal"
    )
    local: np.ndarray = dataset("/local", "1", "channel × 2", "local coordinates on the facet")
    length: np.ndarray = dataset(
        "/length", "m", "channel", "length of the grid that the strain is averaged over, 0: at the point"
    )
    quantity: np.ndarray = dataset("/quantity", "1", "channel", "0 strain, 1 acceleration, 2 displacement")
    gauge: np.ndarray = dataset("/gauge", "1", "channel", "number of the gauge that the channel belongs to")
    array: np.ndarray = dataset(
        "/array", "1", "channel", "0 gauges, then the motion_sensors of the config in their order"
    )
    bonded: np.ndarray = dataset("/glued", "1", "channel", "1 where the gauge is bonded already")

    @classmethod
    def of(cls, pool: Candidates) -> CandidateColumns:
        return cls(**{column.name: getattr(pool, column.name) for column in fields(Candidates)})

    def made(self) -> Candidates:
        return Candidates(**{column.name: getattr(self, column.name) for column in fields(Candidates)})


@record
class GivenRows:
    """Given strain rows (channel × row of the matrices), as the three arrays of a CSR matrix."""

    value: np.ndarray = dataset("/value", "1/m or 1/rad", "value", "given strain per motion of a row of the matrices")
    size: int = dataset("/size", "1", "", "rows of the matrices")
    column: np.ndarray = dataset("/column", "1", "value", "row of the matrices of every value")
    offset: np.ndarray = dataset("/offset", "1", "channel + 1", "values of candidate i are [offset[i], offset[i + 1])")

    @classmethod
    def of(cls, rows: sparse.csr_array) -> GivenRows:
        return cls(
            value=rows.data,
            size=rows.shape[1],
            column=rows.indices.astype("int64"),
            offset=rows.indptr.astype("int64"),
        )

    def made(self) -> sparse.csr_array:
        return sparse.csr_array((self.value, self.column, self.offset), shape=(len(self.offset) - 1, self.size))
