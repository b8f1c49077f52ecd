"""Candidate gauges in a file: `Candidates` by columns, strain rows that a table gave."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.gauges.arms import Arms
from strainsight.gauges.candidates import COLUMNS, Candidates
from strainsight.records.record import dataset, group, record

KIND = "kind of the facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8, 4 and 5 tri6 and quad8 on shells of these"


@record
class ArmColumns:
    """`Arms`, a row an arm of a bridge behind its first."""

    channel: np.ndarray = dataset("/channel", "1", "arm", "channel that the arm is read in")
    sign: np.ndarray = dataset(
        "/sign", "1", "arm", "sign of its strain in the reading of the bridge; that of the first is 1"
    )
    element: np.ndarray = dataset("/element", "1", "arm", "element id of every arm")
    facet: np.ndarray = dataset(
        "/facet", "1", "arm", "facet number within the element, from 1, in the order of this page"
    )
    kind: np.ndarray = dataset("/kind", "1", "arm", KIND)
    nodes: np.ndarray = dataset("/nodes", "1", "arm × 8", "node indices of the facet, −1 where it has fewer")
    position: np.ndarray = dataset("/position", "m", "arm × 3", "where it sits")
    normal: np.ndarray = dataset("/normal", "1", "arm × 3", "outward normal")
    direction: np.ndarray = dataset("/direction", "1", "arm × 3", "measuring direction, in the facet's plane")
    angle: np.ndarray = dataset("/angle", "deg", "arm", "right-handed about the outward normal")
    local: np.ndarray = dataset("/local", "1", "arm × 2", "local coordinates on the facet")
    length: np.ndarray = dataset("/length", "m", "arm", "length of the grid that the strain is averaged over")
    array: np.ndarray = dataset("/array", "1", "arm", "that of the channel")
    bonded: np.ndarray = dataset("/glued", "1", "arm", "1 where the bridge is bonded already")

    @classmethod
    def of(cls, arms: Arms) -> ArmColumns:
        return cls(channel=arms.channel, sign=arms.sign, **{name: getattr(arms.grid, name) for name in GRID})

    def made(self) -> Arms:
        return Arms(self.channel, self.sign, Candidates(**{name: getattr(self, name) for name in GRID}))


GRID = tuple(name for name in COLUMNS if name not in ("quantity", "gauge"))
"""What there is of every arm: each is a gauge of strain."""


@record
class CandidateColumns:
    """`Candidates`, a row a channel; a bridge is one, in the place of its first arm."""

    element: np.ndarray = dataset("/element", "1", "channel", "element id of every candidate")
    facet: np.ndarray = dataset(
        "/facet", "1", "channel", "facet number within the element, from 1, in the order of this page"
    )
    kind: np.ndarray = dataset("/kind", "1", "channel", KIND)
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
    arms: Arms | None = group("/arms", ArmColumns, default=None)

    @classmethod
    def of(cls, pool: Candidates) -> CandidateColumns:
        return cls(**{name: getattr(pool, name) for name in COLUMNS}, arms=pool.arms)

    def made(self) -> Candidates:
        return Candidates(**{name: getattr(self, name) for name in COLUMNS}, arms=self.arms)


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
