"""estimate.h5: the filter on the measurements of a test, and fatigue damage with its interval."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.mixture import Posterior as Posterior
from strainsight.records.placed import Budget
from strainsight.records.record import Source as File
from strainsight.records.record import dataset, group, read, record


@record
class DamageAt:
    """Of some places."""

    position: np.ndarray = dataset("m", "place × 3", "where")
    element: np.ndarray = dataset("1", "place", "element of the file whose surface it is")
    of_mean: np.ndarray = dataset("1", "place", "damage of the smoothed history, without what σ leaves open")
    damage: np.ndarray = dataset("1", "place", "median of the draws' damage, NaN where none were drawn")
    low: np.ndarray = dataset("1", "place", "2.5 % of the draws' damage are smaller")
    high: np.ndarray = dataset("1", "place", "2.5 % are larger")
    range_of_mean: np.ndarray = dataset("Pa", "place", "equivalent range of the smoothed history")
    range: np.ndarray = dataset("Pa", "place", "median of the draws' equivalent range")
    range_low: np.ndarray = dataset("Pa", "place", "2.5 % of them are smaller")
    range_high: np.ndarray = dataset("Pa", "place", "2.5 % are larger")


@record
class Damaged:
    """Damage in a test."""

    surface: DamageAt | None = group(default=None)
    virtual: DamageAt | None = group(default=None)
    hot_spot: np.ndarray | None = dataset(
        "1", "hot spot", "places of /surface, the most damaged first, none near another", default=None
    )
    hours: float = dataset("h", "", "duration of the record, all repetitions")


@record
class TestChannels:
    """The channels of the file."""

    time: np.ndarray = dataset("s", "/time", "sampling times of the channels, the first one starts the filter")
    label: tuple[str, ...] = dataset("1", "/label", "gauge and grid of every channel")
    channel: np.ndarray = dataset("1", "/label", "row of train.h5 of every channel")
    measured: np.ndarray = dataset(
        "unit of the channel", "/time × /label", "calibrated samples, NaN where one is missing"
    )
    estimated: np.ndarray = dataset("unit of the channel", "/time × /label", "their estimate")
    std: np.ndarray = dataset("unit of the channel", "/time × /label", "its claimed σ")
    noise_std: np.ndarray = dataset(
        "unit of the channel", "/label", "σ of the noise of a sample, as the filter took it"
    )


@record
class HoldOut:
    """Every gauge left out in turn, and what the others say that it reads."""

    predicted: np.ndarray = dataset(
        "unit of the channel", "/gauge/time × /gauge/label", "readings by the other gauges, NaN: it is in"
    )
    std: np.ndarray = dataset("unit of the channel", "/gauge/time × /gauge/label", "σ of measured − predicted")
    left_in: tuple[str, ...] = dataset("1", "/gauge/label", "why a gauge was not left out, empty where it was")


@record
class ChannelsChecked:
    """What every channel says against the others."""

    by_others: bool = dataset(
        "1", "", "whether a channel is predicted by all others alone, where faults were looked for"
    )
    begin: float = dataset("s", "", "time of the first sample that the numbers of channels hold for")
    end: float = dataset("s", "", "time of the last one")
    measured: np.ndarray = dataset("unit of the channel", "/gauge/label", "RMS of every channel")
    predicted: np.ndarray = dataset("unit of the channel", "/gauge/label", "RMS of its prediction")
    residual: np.ndarray = dataset("1", "/gauge/label", "RMS of their difference over its claimed σ")
    correlation: np.ndarray = dataset("1", "/gauge/label", "correlation of the channel with its prediction")
    fault: tuple[str, ...] = dataset(
        "1", "/gauge/label", "the fault of the channel that explains the record best; empty: none is better than none"
    )
    gain: np.ndarray = dataset("1", "/gauge/label", "ln of how much more likely the record is with it, 0 without one")
    candidate: tuple[str, ...] = dataset(
        "1", "candidate", "faults that make the record believable, best first; one is named, of several none"
    )


@record
class ChannelOffsets:
    """Channels whose offset is unknown."""

    channel: np.ndarray = dataset("1", "channel", "channels with an unknown offset")
    mean: np.ndarray = dataset("unit of the biased channel", "channel", "their offsets")
    std: np.ndarray = dataset("unit of the biased channel", "channel", "claimed σ of these")


@record
class Resultant:
    """The vector sum of the unknown loads at one place."""

    place: str = dataset("1", "", "node or set that they act on")
    force: np.ndarray = dataset("N", "/time × 3", "sum of the loads there")
    magnitude: np.ndarray = dataset("N", "/time", "its size")
    std: np.ndarray = dataset("N", "/time", "claimed σ of its size")


@record
class VirtualStrain:
    """Strain where no gauge is."""

    strain: np.ndarray = dataset("strain", "/time × grid", "smoothed strain where no gauge is")
    std: np.ndarray = dataset("strain", "/time × grid", "its claimed σ")
    position: np.ndarray = dataset("m", "grid × 3", "where")
    direction: np.ndarray = dataset("1", "grid × 3", "along what")


GRID_FILTER, SIGMA_POINT, EXTENDED = "bank", "sigma-point", "extended"
"""Filters that are compared."""


@record
class Compared:
    """The filters of a structure or a bench on the same samples, tolerances left out."""

    filter: tuple[str, ...] = dataset("1", "/filter", "bank (grid filter), sigma-point (structures only), extended")
    estimate: dict[str, np.ndarray] = dataset(
        "unit of <name>", "/filter", "estimate of <name> at the end by every filter, NaN of one that diverged"
    )
    std: dict[str, np.ndarray] = dataset("unit of <name>", "/filter", "its claimed standard deviation")
    ratio: dict[str, np.ndarray] = dataset(
        "1", "/filter", "RMS error that the grid filter's posterior expects of the estimate, over that"
    )


@record
class SurfaceMoment:
    """The surface at the moment of the largest reading; facets as `exterior_facets` of the mesh of import.h5 has them."""

    time: float = dataset("s", "", "instant of the largest reading, on the clock of the file")
    label: str = dataset("1", "", "channel that has it")
    displacement: np.ndarray = dataset("m", "node × 3", "smoothed displacement then, nodes of import.h5")
    strain: np.ndarray = dataset(
        "strain", "exterior facet × 6", "smoothed strain then, γ for shear, at the middle of the facet"
    )
    principal_strain: np.ndarray = dataset(
        "strain", "exterior facet", "the principal strain of largest size then, with its sign"
    )
    von_mises: np.ndarray = dataset("Pa", "exterior facet", "von Mises stress then")
    von_mises_std: np.ndarray | None = dataset(
        "Pa", "exterior facet", "its claimed σ, where σ is not withheld", default=None
    )


@record
class TestSource:
    """The file of the test, and what was done to every channel of it that was used."""

    file: str = dataset("1", "", "name of the file")
    sha256: str = dataset("1", "", "digest of its bytes")
    bytes: int = dataset("1", "", "its size in bytes")
    format: str = dataset("1", "", "format of its file: csv, hdf5, uff58, mdf, tdms or mat")
    date: str = dataset("1", "", "when it was measured, as the config states it; empty where it does not")
    channel: tuple[str, ...] = dataset("1", "/channel", "name of every channel in the file")
    measures: tuple[str, ...] = dataset("1", "/channel", "the gauge and grid, or the known load, it is")
    unit: tuple[str, ...] = dataset("1", "/channel", "unit of its readings as stated")
    bridge: tuple[str, ...] = dataset("1", "/channel", "arrangement of its bridge, empty without one")
    gauge_factor: np.ndarray = dataset("1", "/channel", "gauge factor, NaN without a bridge")
    poisson_ratio: np.ndarray = dataset("1", "/channel", "that the bridge goes by, else NaN")
    sign: np.ndarray = dataset("1", "/channel", "-1: wired the other way round")
    scale: np.ndarray = dataset("1", "/channel", "factor on the calibrated signal")
    offset: np.ndarray = dataset("see /source/unit", "/channel", "subtracted from the readings")
    drift: np.ndarray = dataset(
        "see /source/unit, per second", "/channel", "subtracted, times the time since the start"
    )
    zero: np.ndarray = dataset("s", "/channel × 2", "from, to: the mean there is subtracted; NaN where none is")
    delay: np.ndarray = dataset("s", "/channel", "that it was late by in the file; negative: early")


@record
class UnknownHistories:
    """Every unknown in time."""

    estimate: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "filtered estimate of <name>")
    std: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "claimed standard deviation of the filtered <name>")
    smoothed: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "smoothed estimate of <name>")
    smoothed_std: dict[str, np.ndarray] = dataset(
        "unit of <name>", "/time", "claimed standard deviation of the smoothed <name>"
    )
    posterior: dict[str, Posterior] = group(unit="unit of <name>", what="<name>")
    compared: Compared | None = group(default=None)
    budget: Budget | None = group(default=None)


@record
class Estimated(UnknownHistories):
    """estimate.h5 of a placement."""

    time: np.ndarray = dataset("s", "/time", "time of the estimates, on the clock of the file")
    gauge: TestChannels = group()
    whitened: np.ndarray = dataset(
        "1",
        "/gauge/time × /gauge/label",
        "innovations over their σ, white if the model is true",
        path="/consistency/whitened",
    )
    hold_out: HoldOut | None = group(default=None)
    trusted: bool = dataset("1", "", "whether the record agrees with the model; where not, no σ is to be trusted")
    check: ChannelsChecked = group(path="/channel_check")
    bias: ChannelOffsets | None = group(default=None)
    resultant: dict[str, Resultant] = group()
    virtual: VirtualStrain | None = group(default=None)
    known: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "known load <name> as measured")
    moment: SurfaceMoment | None = group(default=None)
    source: TestSource = group()
    damage: Damaged | None = group(default=None)
    notes: tuple[str, ...] = dataset("1", "sentence", "what was done to the measurements, and doubts")


@record
class CampaignRecord:
    """What estimate.h5 has of several records beside each of them, which stands below /record/NAME."""

    name: tuple[str, ...] = dataset(
        "1", "/records", "names of the records, in the order of the config", path="/records"
    )
    alone: dict[str, np.ndarray] = dataset("unit of <name>", "/records", "most likely <name> by each record alone")
    gain: float = dataset(
        "1",
        "",
        "ln of how much more likely the records are with one set of parameters and bonded gauges than each with its "
        "own",
    )
    posterior: dict[str, Posterior] = group(unit="unit of <name>", what="<name>")
    damage: Damaged | None = group(default=None)


def record_group(name: str) -> str:
    """Where a record of a campaign stands."""
    return f"/record/{name}"


def campaign_in(source: File) -> CampaignRecord | None:
    """What several records of estimate.h5 share; None of a test that is one record."""
    return read(CampaignRecord, source) if "/records" in source else None


def estimated_in(source: File) -> dict[str, Estimated]:
    """The records of estimate.h5 by their names, in their order; of an empty name where the test is one record."""
    campaign = campaign_in(source)
    if campaign is None:
        return {"": read(Estimated, source)}
    return {name: read(Estimated, source, record_group(name)) for name in campaign.name}
