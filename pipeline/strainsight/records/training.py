"""train.h5 and screen.h5: candidates, their readings under the training load, and which of them go on (5.2)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse

from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.records.record import dataset, group, record, record_from
from strainsight.records.reduced import ChangeTerms
from strainsight.sensors.candidates import ACCELERATION, COLUMNS, Arms, Candidates


@record
class GridColumns:
    """What there is of every grid of a gauge, and of every channel of another sensor."""

    element: np.ndarray = dataset("1", "<what>", "element id of every <what>")
    facet: np.ndarray = dataset("1", "<what>", "facet number within the element, from 1, in the order of this page")
    kind: np.ndarray = dataset(
        "1", "<what>", "kind of the facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8, 4 and 5 tri6 and quad8 on shells of these"
    )
    nodes: np.ndarray = dataset("1", "<what> × 8", "node indices of the facet, −1 where it has fewer")
    position: np.ndarray = dataset("m", "<what> × 3", "where it sits, of a candidate the facet's centre")
    normal: np.ndarray = dataset("1", "<what> × 3", "outward normal")
    direction: np.ndarray = dataset("1", "<what> × 3", "measuring direction, of strain in the facet's plane")
    angle: np.ndarray = dataset("deg", "<what>", "from the projected axis, right-handed about the outward normal")
    local: np.ndarray = dataset("1", "<what> × 2", "local coordinates on the facet")
    length: np.ndarray = dataset("m", "<what>", "length of the grid that the strain is averaged over, 0: at the point")
    array: np.ndarray = dataset("1", "<what>", "0 gauges, then the motion_sensors of the config in their order")
    bonded: np.ndarray = dataset("1", "<what>", "1 where the gauge or bridge is bonded already", path="/glued")


@record
class ArmColumns(GridColumns):
    """`Arms`, a row an arm of a bridge behind its first; each is a gauge of strain."""

    channel: np.ndarray = dataset("1", "<what>", "channel that the arm is read in")
    sign: np.ndarray = dataset("1", "<what>", "sign of its strain in the reading of the bridge; that of the first is 1")

    @classmethod
    def of(cls, arms: Arms) -> ArmColumns:
        return record_from(cls, arms.grid, channel=arms.channel, sign=arms.sign)

    def made(self) -> Arms:
        columns = {name: getattr(self, name) for name in COLUMNS if name not in ("quantity", "gauge")}
        return Arms(self.channel, self.sign, Candidates(**columns))


@record
class CandidateColumns(GridColumns):
    """`Candidates`, a row a channel; a bridge is one, in the place of its first arm."""

    quantity: np.ndarray = dataset("1", "<what>", "0 strain, 1 acceleration, 2 displacement")
    gauge: np.ndarray = dataset("1", "<what>", "number of the gauge that the channel belongs to")
    arms: Arms | None = group(ArmColumns, what="arm", default=None)

    @classmethod
    def of(cls, pool: Candidates) -> CandidateColumns:
        return record_from(cls, pool)

    def made(self) -> Candidates:
        return Candidates(**{name: getattr(self, name) for name in COLUMNS}, arms=self.arms)


@record
class GivenRows:
    """Given strain rows (channel × row of the matrices), as the three arrays of a CSR matrix."""

    value: np.ndarray = dataset("1/m or 1/rad", "value", "given strain per motion of a row of the matrices")
    size: int = dataset("1", "", "rows of the matrices")
    column: np.ndarray = dataset("1", "value", "row of the matrices of every value")
    offset: np.ndarray = dataset("1", "channel + 1", "values of candidate i are [offset[i], offset[i + 1])")

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


@record
class CaseMotion:
    """The training run of a load case."""

    time: np.ndarray = dataset("s", "instant", "time of the training run of the load case")
    load: np.ndarray = dataset("unit of the loads", "instant × input", "its loads", path="/input")
    coordinate: np.ndarray = dataset("kg^1/2 m", "instant × coordinate", "reduced coordinates q")
    velocity: np.ndarray = dataset("kg^1/2 m/s", "instant × coordinate", "reduced velocities")
    rms: np.ndarray = dataset("unit of the channel", "channel", "RMS reading of every channel")
    peak: np.ndarray = dataset("unit of the channel", "channel", "largest reading of every channel")


@record
class Training:
    """train.h5."""

    candidates: Candidates = group(CandidateColumns, what="channel", path="/gauges")
    name: tuple[str, ...] = dataset(
        "1",
        "gauge",
        "what the config calls every gauge; empty: nothing, it is named in the layout",
        path="/gauges/name",
    )
    rows: np.ndarray = dataset(
        "unit of the row",
        "channel × coordinate",
        "strain, or displacement [m], per reduced coordinate",
        path="/gauges/row",
    )
    row_change: AffineOperator | None = group(
        ChangeTerms,
        "unit of the row",
        "what a free thickness of shells adds to the rows",
        path="/gauges/row_change",
        default=None,
    )
    missed: np.ndarray = dataset(
        "strain/N/rad or strain/N/m",
        "channel × input × misalignment",
        "static strain, or displacement [m], of a load's misalignments that no coordinate holds",
        path="/gauges/missed",
    )
    given: sparse.csr_array | None = group(GivenRows, path="/gauges/given", default=None)
    moved: np.ndarray | None = dataset(
        "m", "bonded gauge", "how far every bonded gauge was moved to the surface", path="/glued/distance", default=None
    )
    time: np.ndarray = dataset("s", "/time", "time of the training run")
    load: np.ndarray = dataset("unit of the loads", "/time × input", "training load", path="/input")
    coordinate: np.ndarray = dataset("kg^1/2 m", "/time × coordinate", "reduced coordinates q")
    velocity: np.ndarray = dataset("kg^1/2 m/s", "/time × coordinate", "reduced velocities")
    acceleration: np.ndarray = dataset("kg^1/2 m/s^2", "/time × coordinate", "reduced accelerations")
    rms_as_stated: np.ndarray = dataset("unit of the channel", "channel", "RMS reading of every channel", path="/rms")
    peak_as_stated: np.ndarray = dataset(
        "unit of the channel", "channel", "largest reading of every channel", path="/peak"
    )
    cases: dict[str, CaseMotion] = group(path="/load_cases/<name>")
    arm_peak: np.ndarray | None = dataset(
        "unit of the channel",
        "channel",
        "largest reading of any grid of every channel, of a bridge of its arms, in any load case; where there are "
        "bridges",
        default=None,
    )

    @property
    def change(self) -> AffineOperator:
        """What θ adds to the rows (m, n), which are those at the references."""
        return NO_CHANGE if self.row_change is None else self.row_change

    def rows_at(self, theta: Mapping[str, float]) -> np.ndarray:
        """Rows (m, n) at θ [SI]."""
        return np.asarray(self.rows + self.change.at(theta))

    def reading(self, channels: np.ndarray | None = None) -> np.ndarray:
        """What channels (k,), by default all, read under the loads as stated (T + 1, k): row·q, of accelerometers row·q̈."""
        own = np.arange(len(self.rows)) if channels is None else np.asarray(channels)
        moving = self.candidates.quantity[own] == ACCELERATION
        found = self.coordinate @ self.rows[own].T
        if moving.any():
            found[:, moving] = self.acceleration @ self.rows[own[moving]].T
        return found

    def motion_in(self, case: str) -> Training | CaseMotion:
        """The run of a load case; "": that under the loads as stated."""
        return self.cases[case] if case else self

    @property
    def motions(self) -> tuple[Training | CaseMotion, ...]:
        """The runs that a layout is placed for: those of the load cases by name, where there are some, else the one as stated."""
        return tuple(self.cases[name] for name in sorted(self.cases)) or (self,)

    @property
    def rms_in_cases(self) -> np.ndarray:
        """RMS reading of every channel (cases, m) in every load case by name, or (1, m) under the loads as stated."""
        if self.cases:
            return np.array([self.cases[name].rms for name in sorted(self.cases)])
        return self.rms_as_stated[None]

    @property
    def rms(self) -> np.ndarray:
        """RMS reading of every channel (m,), in the load case where it is largest."""
        return np.asarray(self.rms_in_cases.max(axis=0))

    @property
    def peak(self) -> np.ndarray:
        """Largest reading of every channel (m,), in any load case."""
        if self.cases:
            return np.max([own.peak for own in self.cases.values()], axis=0)
        return self.peak_as_stated

    @property
    def strained(self) -> np.ndarray:
        """Largest reading of any grid of every channel (m,), in any load case: what a range limits."""
        return self.peak if self.arm_peak is None else self.arm_peak

    @property
    def moment(self) -> np.ndarray:
        """Mean of q qᵀ over a run (n, n), and of that over the load cases."""
        return np.mean([own.coordinate.T @ own.coordinate / len(own.coordinate) for own in self.motions], axis=0)


STATED, CARRIER = "stated", "carrier"
"""Where a clearance comes from: the config, or the carrier of the gauge."""


@record
class Clearance:
    """How far gauges stay from edges, supports and loads."""

    distance: float = dataset("m", "", "clearance that was kept from the centre of a gauge, 0: none")
    wanted: float = dataset("m", "", "clearance that was to be kept, where the part leaves the choice for it")
    rule: str = dataset("1", "", "whose it is: stated, or carrier, the default")
    near: dict[str, int] = dataset(
        "1",
        "",
        "how many candidates are nearer to <name>: edges, supports, loads, faces of gauges.exclude, bends too tight "
        "for gauges.type",
    )


@record
class Screened:
    """screen.h5."""

    kept: np.ndarray = dataset("1", "kept", "number of every kept gauge, ascending")
    snr: np.ndarray = dataset(
        "1",
        "gauge",
        "RMS over noise of what an unknown alone makes every gauge read in training, of the unknown and load case "
        "where it is largest; by strength: of the training reading",
    )
    reason: np.ndarray = dataset("1", "gauge", "why a gauge was dropped; empty where it was kept")
    clearance: Clearance | None = group(default=None)
    noise_std: np.ndarray = dataset(
        "unit of the channel", "channel", "noise of one sample of every channel at the training time step"
    )
    installation: np.ndarray | None = dataset(
        "unit of the variance",
        "case × channel",
        "mean square of what errors of installation add to the readings, in every load case by name, or under the "
        "loads as stated; zero for what is too near to an edge, a support or a load; where such errors are avoided",
        default=None,
    )
    range: np.ndarray = dataset("unit of the channel", "channel", "what every channel can measure; inf: not stated")
    family: tuple[str, ...] = dataset(
        "1", "kind", "name of every kind of sensor, as /gauges/array of train.h5 counts them"
    )


def with_missed(basis: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """Basis (rows, n), and behind it what it misses of misaligned loads (rows, n_u, misalignments) as columns."""
    return np.hstack([basis, missed.reshape(len(missed), -1)])
