"""train.h5 and screen.h5: candidates, their readings under the training loads, and the selected pool (5.2)."""

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
    """Data of every grid of a gauge, and of every channel of another sensor."""

    element: np.ndarray = dataset("1", "<what>", "element id of every <what>")
    facet: np.ndarray = dataset(
        "1", "<what>", "facet number in the element, from 1 (numbering of the facets: docs/artefacts.md)"
    )
    kind: np.ndarray = dataset(
        "1", "<what>", "kind of facet: 0 tri3, 1 tri6, 2 quad4, 3 quad8, 4 tri6 of a shell, 5 quad8 of a shell"
    )
    nodes: np.ndarray = dataset("1", "<what> × 8", "node indices of the facet; −1: no node")
    position: np.ndarray = dataset(
        "m", "<what> × 3", "measuring point, in global axes; for a candidate, the centre of the facet"
    )
    normal: np.ndarray = dataset("1", "<what> × 3", "outward normal of the facet, in global axes")
    direction: np.ndarray = dataset(
        "1", "<what> × 3", "measuring direction, in global axes; for strain, in the plane of the facet"
    )
    angle: np.ndarray = dataset(
        "deg",
        "<what>",
        "configured angle of the measuring direction, counter-clockwise about the outward normal: from `gauges.direction.axis` "
        "projected onto the facet, or from the principal strain direction",
    )
    local: np.ndarray = dataset("1", "<what> × 2", "local coordinates of the measuring point on the facet")
    length: np.ndarray = dataset(
        "m",
        "<what>",
        "length of the measuring grid, over which the strain is averaged; 0: strain at the measuring point",
    )
    array: np.ndarray = dataset(
        "1", "<what>", "0 for gauges; for other sensors, number of the entry of `motion_sensors` in the config, from 1"
    )
    bonded: np.ndarray = dataset("1", "<what>", "1 if the gauge or bridge is already bonded", path="/glued")


@record
class ArmColumns(GridColumns):
    """`Arms`, one row for each additional arm of a bridge; each arm is a strain gauge."""

    channel: np.ndarray = dataset("1", "<what>", "channel number of every bridge arm")
    sign: np.ndarray = dataset("1", "<what>", "sign of the arm strain in the bridge reading; first arm: +1")

    @classmethod
    def of(cls, arms: Arms) -> ArmColumns:
        return record_from(cls, arms.grid, channel=arms.channel, sign=arms.sign)

    def restore(self) -> Arms:
        columns = {name: getattr(self, name) for name in COLUMNS if name not in ("quantity", "gauge")}
        return Arms(self.channel, self.sign, Candidates(**columns))


@record
class CandidateColumns(GridColumns):
    """`Candidates`, one row per channel; a bridge is one channel, at the position of its first arm."""

    quantity: np.ndarray = dataset("1", "<what>", "measured quantity: 0 strain, 1 acceleration, 2 displacement")
    gauge: np.ndarray = dataset("1", "<what>", "gauge number of every channel")
    arms: Arms | None = group(ArmColumns, what="arm", default=None)

    @classmethod
    def of(cls, pool: Candidates) -> CandidateColumns:
        return record_from(cls, pool)

    def restore(self) -> Candidates:
        return Candidates(**{name: getattr(self, name) for name in COLUMNS}, arms=self.arms)


@record
class StrainOperatorRows:
    """Imported strain operator (channel × matrix row), as the three arrays of a CSR matrix."""

    value: np.ndarray = dataset(
        "1/m or 1/rad",
        "value",
        "strain of a channel per unit translation or rotation of one degree of freedom (row of the imported matrices)",
    )
    size: int = dataset("1", "", "number of rows of the imported matrices")
    column: np.ndarray = dataset(
        "1", "value", "degree of freedom of every entry of `value`, as row number of the imported matrices"
    )
    offset: np.ndarray = dataset(
        "1", "channel + 1", "start of every channel in `value`; channel i has the values offset[i] to offset[i + 1] − 1"
    )

    @classmethod
    def of(cls, rows: sparse.csr_array) -> StrainOperatorRows:
        return cls(
            value=rows.data, size=rows.shape[1], column=rows.indices.astype("int64"), offset=rows.indptr.astype("int64")
        )

    def restore(self) -> sparse.csr_array:
        return sparse.csr_array((self.value, self.column, self.offset), shape=(len(self.offset) - 1, self.size))


@record
class CaseMotion:
    """Training simulation of a load case."""

    time: np.ndarray = dataset("s", "instant", "times of the simulation of this load case in the stage `train`")
    load: np.ndarray = dataset(
        "unit of the loads", "instant × input", "simulated loads of this load case", path="/input"
    )
    coordinate: np.ndarray = dataset("kg^1/2 m", "instant × coordinate", "reduced coordinates q")
    velocity: np.ndarray = dataset("kg^1/2 m/s", "instant × coordinate", "reduced velocities")
    rms: np.ndarray = dataset("unit of the channel", "channel", "RMS reading of every channel in this load case")
    peak: np.ndarray = dataset(
        "unit of the channel", "channel", "largest absolute reading of every channel in this load case"
    )


@record
class Training:
    """train.h5."""

    candidates: Candidates = group(CandidateColumns, what="channel", path="/gauges")
    name: tuple[str, ...] = dataset(
        "1",
        "gauge",
        "name of every bonded gauge in the config; empty: candidate gauge, which is named only in the layout",
        path="/gauges/name",
    )
    rows: np.ndarray = dataset(
        "unit of the strain operator",
        "channel × coordinate",
        "strain operator: strain, or displacement [m], of every channel per unit of each reduced coordinate",
        path="/gauges/row",
    )
    row_change: AffineOperator | None = group(
        ChangeTerms,
        "unit of the strain operator",
        "part of the strain operator that depends on estimated shell thicknesses",
        path="/gauges/row_change",
        default=None,
    )
    missed: np.ndarray = dataset(
        "strain/N/rad or strain/N/m",
        "channel × input × misalignment",
        "part that the reduction basis cannot represent: change of the static strain, or displacement [m], under a unit load, "
        "per unit misalignment of this load (two rotations, two shifts)",
        path="/gauges/missed",
    )
    strain_operator: sparse.csr_array | None = group(StrainOperatorRows, path="/gauges/strain_operator", default=None)
    moved: np.ndarray | None = dataset(
        "m",
        "bonded gauge",
        "distance by which every bonded gauge was moved to the surface",
        path="/glued/distance",
        default=None,
    )
    time: np.ndarray = dataset("s", "/time", "times of the simulation under the configured loads in the stage `train`")
    load: np.ndarray = dataset(
        "unit of the loads", "/time × input", "configured loads in the simulation of the stage `train`", path="/input"
    )
    coordinate: np.ndarray = dataset("kg^1/2 m", "/time × coordinate", "reduced coordinates q")
    velocity: np.ndarray = dataset("kg^1/2 m/s", "/time × coordinate", "reduced velocities")
    acceleration: np.ndarray = dataset("kg^1/2 m/s^2", "/time × coordinate", "reduced accelerations")
    rms_as_stated: np.ndarray = dataset(
        "unit of the channel", "channel", "RMS reading of every channel under the configured loads", path="/rms"
    )
    peak_as_stated: np.ndarray = dataset(
        "unit of the channel",
        "channel",
        "largest absolute reading of every channel under the configured loads",
        path="/peak",
    )
    cases: dict[str, CaseMotion] = group(path="/load_cases/<name>")
    arm_peak: np.ndarray | None = dataset(
        "unit of the channel",
        "channel",
        "largest absolute reading of a single bridge arm of every channel, over all load cases; only stored if there are "
        "bridges",
        default=None,
    )

    @property
    def change(self) -> AffineOperator:
        """Contribution of θ to the strain operator (m, n), which is stored at the references."""
        return NO_CHANGE if self.row_change is None else self.row_change

    def rows_at(self, theta: Mapping[str, float]) -> np.ndarray:
        """Strain operator (m, n) at θ [SI]."""
        return np.asarray(self.rows + self.change.at(theta))

    def reading(self, channels: np.ndarray | None = None) -> np.ndarray:
        """Readings (T + 1, k) of channels (k,), default all, under the configured loads: row·q, for accelerometers row·q̈."""
        selected = np.arange(len(self.rows)) if channels is None else np.asarray(channels)
        moving = self.candidates.quantity[selected] == ACCELERATION
        readings = self.coordinate @ self.rows[selected].T
        if moving.any():
            readings[:, moving] = self.acceleration @ self.rows[selected[moving]].T
        return readings

    def motion_in(self, case: str) -> Training | CaseMotion:
        """Training simulation of a load case; "": the configured loads."""
        return self.cases[case] if case else self

    @property
    def motions(self) -> tuple[Training | CaseMotion, ...]:
        """Training runs for the placement: the load cases by name, or the configured loads."""
        return tuple(self.cases[name] for name in sorted(self.cases)) or (self,)

    @property
    def rms_in_cases(self) -> np.ndarray:
        """RMS reading of every channel (cases, m) in every load case by name, or (1, m) under the configured loads."""
        if self.cases:
            return np.array([self.cases[name].rms for name in sorted(self.cases)])
        return self.rms_as_stated[None]

    @property
    def rms(self) -> np.ndarray:
        """RMS reading of every channel (m,), in the load case with the largest value."""
        return np.asarray(self.rms_in_cases.max(axis=0))

    @property
    def peak(self) -> np.ndarray:
        """Largest reading of every channel (m,), in any load case."""
        if self.cases:
            return np.max([case.peak for case in self.cases.values()], axis=0)
        return self.peak_as_stated

    @property
    def strained(self) -> np.ndarray:
        """Largest reading of any grid of every channel (m,), in any load case, for comparison with the range."""
        return self.peak if self.arm_peak is None else self.arm_peak

    @property
    def moment(self) -> np.ndarray:
        """Mean of q qᵀ over a run (n, n), averaged over the load cases."""
        return np.mean(
            [motion.coordinate.T @ motion.coordinate / len(motion.coordinate) for motion in self.motions], axis=0
        )


STATED, CARRIER = "stated", "carrier"
"""Origin of a clearance: the config, or the gauge carrier."""


@record
class Clearance:
    """Clearance of gauges from edges, supports and loads."""

    distance: float = dataset("m", "", "applied clearance of gauge centres from edges, supports and loads; 0: none")
    wanted: float = dataset("m", "", "required clearance; if the part is too small, the applied clearance is smaller")
    rule: str = dataset(
        "1", "", "origin of the clearance: stated (in the config) or carrier (default for the carrier of the gauge)"
    )
    near: dict[str, int] = dataset(
        "1",
        "",
        "number of candidates too close to <name>: edges, supports, loads, faces of gauges.exclude, or surfaces "
        "below the bend radius of gauges.type",
    )
    needed: int = dataset("1", "", "number of separate locations that the default clearance has to leave")


@record
class Screened:
    """screen.h5."""

    kept: np.ndarray = dataset(
        "1",
        "screened gauge",
        "numbers of the candidate gauges that remain after the stage `screen`, in ascending order",
    )
    snr: np.ndarray = dataset(
        "1",
        "gauge",
        "largest ratio of RMS reading to noise, over all load cases and unknowns (each unknown alone). With "
        "`screen.by: strength`: ratio of the RMS reading in the stage `train` to the noise",
    )
    reason: np.ndarray = dataset(
        "1", "gauge", "reason why the stage `screen` removed the gauge; empty: the gauge remains"
    )
    clearance: Clearance | None = group(default=None)
    noise_std: np.ndarray = dataset(
        "unit of the channel",
        "channel",
        "noise standard deviation of one sample of every channel at the time step `train.time_step`",
    )
    installation: np.ndarray | None = dataset(
        "(unit of the channel)^2",
        "case × channel",
        "mean square error of every reading due to installation errors, in every load case (sorted by name) or "
        "under the configured loads. Zero for candidates too close to edges, supports or loads. Only stored with "
        "`place.installation: avoid`",
        default=None,
    )
    range: np.ndarray = dataset(
        "unit of the channel", "channel", "measuring range of every channel; inf: not specified"
    )
    family: tuple[str, ...] = dataset(
        "1", "kind", "config section of every kind of sensor; /gauges/array of train.h5 is the index into this list"
    )


def with_missed(basis: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """Basis (rows, n), followed by columns for misaligned loads (rows, n_u, misalignments) outside its span."""
    return np.hstack([basis, missed.reshape(len(missed), -1)])
