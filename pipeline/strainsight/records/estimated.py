"""estimate.h5: the filter on the measurements of a test, and fatigue damage with its uncertainty interval."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.mixture import Posterior as Posterior
from strainsight.records.placed import Budget
from strainsight.records.record import Source as File
from strainsight.records.record import dataset, group, read, record


@record
class DamageAt:
    """Fatigue damage at some points."""

    position: np.ndarray = dataset("m", "point × 3", "position of every point with a fatigue damage, in global axes")
    element: np.ndarray = dataset("1", "point", "element id of every point with a fatigue damage")
    of_mean: np.ndarray = dataset("1", "point", "fatigue damage of the smoothed stress history, without uncertainty")
    damage: np.ndarray = dataset("1", "point", "posterior median of the fatigue damage; NaN: no posterior samples")
    low: np.ndarray = dataset("1", "point", "2.5 % quantile of the posterior fatigue damage")
    high: np.ndarray = dataset("1", "point", "97.5 % quantile of the posterior fatigue damage")
    range_of_mean: np.ndarray = dataset("Pa", "point", "damage-equivalent stress range of the smoothed stress history")
    range: np.ndarray = dataset("Pa", "point", "posterior median of the damage-equivalent stress range")
    range_low: np.ndarray = dataset("Pa", "point", "2.5 % quantile of the posterior damage-equivalent stress range")
    range_high: np.ndarray = dataset("Pa", "point", "97.5 % quantile of the posterior damage-equivalent stress range")


@record
class Damaged:
    """Fatigue damage in a test."""

    surface: DamageAt | None = group(default=None)
    virtual: DamageAt | None = group(default=None)
    hot_spot: np.ndarray | None = dataset(
        "1",
        "hot spot",
        "indices of the hot spots in /damage/surface: points with the largest damage at a minimum distance from each other, "
        "largest damage first",
        default=None,
    )
    hours: float = dataset(
        "h", "", "time in which the damage accumulates: duration of all test records × estimate.damage.repetitions"
    )


@record
class TestChannels:
    """Channels of the file."""

    time: np.ndarray = dataset("s", "/time", "sampling times of the channels; the filter starts at the first time")
    label: tuple[str, ...] = dataset("1", "/label", "gauge and measuring grid of every channel")
    channel: np.ndarray = dataset("1", "/label", "row of every channel in /gauges of train.h5")
    measured: np.ndarray = dataset(
        "unit of the channel", "/time × /label", "calibrated samples of every channel; NaN: missing sample"
    )
    estimated: np.ndarray = dataset("unit of the channel", "/time × /label", "estimated reading of every channel")
    std: np.ndarray = dataset("unit of the channel", "/time × /label", "standard deviation of every estimated reading")
    noise_std: np.ndarray = dataset(
        "unit of the channel",
        "/label",
        "noise standard deviation of one sample of every channel, in the filter",
    )


@record
class HoldOut:
    """Cross-validation: each gauge is left out in turn and predicted from the others."""

    predicted: np.ndarray = dataset(
        "unit of the channel",
        "/gauge/time × /gauge/label",
        "readings of every channel, predicted from the other gauges; NaN: not predicted",
    )
    std: np.ndarray = dataset(
        "unit of the channel",
        "/gauge/time × /gauge/label",
        "standard deviation of the difference between measured and predicted reading",
    )
    left_in: tuple[str, ...] = dataset(
        "1",
        "/gauge/label",
        "reason why a channel could not be left out of the filter and predicted; empty: left out and predicted",
    )
    field_factor: float | None = dataset(
        "1",
        "",
        "factor on σ of strain and stress at positions without gauges: RMS of error / σ of all held-out channels; 1: they are "
        "consistent; above 3: this σ is withheld",
        default=None,
    )


@record
class ChannelsChecked:
    """Comparison of every channel with its prediction from the others, or one step ahead."""

    by_others: bool = dataset(
        "1",
        "",
        "1: every channel is predicted from all other channels (fault search); 0: every channel is predicted one step ahead "
        "from all channels",
    )
    begin: float = dataset("s", "", "time of the first sample in the comparison of measured and predicted readings")
    end: float = dataset("s", "", "time of the last sample in the comparison of measured and predicted readings")
    measured: np.ndarray = dataset(
        "unit of the channel", "/gauge/label", "RMS of the measured readings of every channel"
    )
    predicted: np.ndarray = dataset(
        "unit of the channel", "/gauge/label", "RMS of the predicted readings of every channel"
    )
    residual: np.ndarray = dataset("1", "/gauge/label", "RMS of (measured − predicted reading) / σ of the difference")
    correlation: np.ndarray = dataset("1", "/gauge/label", "correlation coefficient of measured and predicted readings")
    fault: tuple[str, ...] = dataset(
        "1",
        "/gauge/label",
        "most likely fault of every channel; empty: no fault improves the agreement of measurement and prediction",
    )
    gain: np.ndarray = dataset(
        "1",
        "/gauge/label",
        "logarithm of the ratio of the likelihoods with and without the most likely fault of every channel; 0: no fault",
    )
    candidate: tuple[str, ...] = dataset(
        "1",
        "candidate",
        "faults that explain the inconsistency with the model, most likely first; a single entry is the identified fault",
    )


@record
class ChannelOffsets:
    """Channels with an unknown offset."""

    channel: np.ndarray = dataset("1", "channel", "indices of the channels with unknown zero offset, in /gauge/label")
    mean: np.ndarray = dataset(
        "unit of the channel", "channel", "estimated offset of each channel with unknown zero offset"
    )
    std: np.ndarray = dataset("unit of the channel", "channel", "standard deviation of every estimated zero offset")


@record
class Resultant:
    """Vector sum of the unknown loads at one location."""

    place: str = dataset("1", "", "node or node set on which the unknown loads act")
    force: np.ndarray = dataset("N", "/time × 3", "vector sum of the unknown loads on `place`, in global axes")
    magnitude: np.ndarray = dataset("N", "/time", "magnitude of `force`, the vector sum of the unknown loads")
    std: np.ndarray = dataset("N", "/time", "standard deviation of `magnitude`")


@record
class VirtualStrain:
    """Virtual gauges: estimated strain at locations without a gauge."""

    strain: np.ndarray = dataset(
        "strain", "/time × grid", "smoothed strain at every measuring grid of the virtual gauges"
    )
    std: np.ndarray = dataset(
        "strain",
        "/time × grid",
        "standard deviation of every smoothed strain, multiplied by field_factor of the hold-out test",
    )
    position: np.ndarray = dataset(
        "m", "grid × 3", "position of every measuring grid of the virtual gauges, in global axes"
    )
    direction: np.ndarray = dataset(
        "1", "grid × 3", "measuring direction of every measuring grid of the virtual gauges, in global axes"
    )


GRID_FILTER, SIGMA_POINT, EXTENDED = "grid", "sigma-point", "extended"
"""Names of the compared filters."""


@record
class Compared:
    """Results of the filters of a structure or a bench on the same samples, without tolerances."""

    filter: tuple[str, ...] = dataset(
        "1", "/filter", "name of every filter: grid (parameter grid filter), sigma-point (not for benches), extended"
    )
    estimate: dict[str, np.ndarray] = dataset(
        "unit of <name>", "/filter", "final estimate of <name> by every filter; NaN: diverged"
    )
    std: dict[str, np.ndarray] = dataset(
        "unit of <name>", "/filter", "standard deviation of the final estimate of <name>"
    )
    ratio: dict[str, np.ndarray] = dataset(
        "1",
        "/filter",
        "RMS error of the final estimate of <name> by every filter, if <name> is distributed as in the posterior of the "
        "grid filter; divided by the σ of this estimate",
    )


@record
class SurfaceMoment:
    """Surface at the instant of the largest reading; facets as in `exterior_facets` of the mesh of import.h5."""

    time: float = dataset("s", "", "time of the largest reading, on the time axis of the test file")
    label: str = dataset("1", "", "channel with the largest reading")
    displacement: np.ndarray = dataset(
        "m",
        "node × 3",
        "smoothed displacement of the nodes of import.h5 at the time of the largest reading, in global axes",
    )
    strain: np.ndarray = dataset(
        "strain",
        "exterior facet × 6",
        "smoothed strain [xx, yy, zz, xy, yz, zx] at the facet centres, in global axes; the shear components are "
        "engineering shear strains γ",
    )
    principal_strain: np.ndarray = dataset(
        "strain", "exterior facet", "principal strain of the largest magnitude at the facet centres, with sign"
    )
    von_mises: np.ndarray = dataset("Pa", "exterior facet", "von Mises stress at the facet centres")
    von_mises_std: np.ndarray | None = dataset(
        "Pa",
        "exterior facet",
        "standard deviation of the von Mises stress at the facet centres, multiplied by field_factor of the hold-out test; "
        "missing if not computed",
        default=None,
    )


@record
class TestSource:
    """The file of the test, and the corrections of its channels."""

    file: str = dataset("1", "", "name of the test file")
    sha256: str = dataset("1", "", "SHA-256 checksum of the test file")
    bytes: int = dataset("1", "", "size of the test file in bytes")
    format: str = dataset("1", "", "file format: csv, hdf5, uff58, mdf, tdms or mat")
    date: str = dataset("1", "", "date of the test from the config; empty: not set")
    channel: tuple[str, ...] = dataset("1", "/channel", "name of every channel in the file")
    measures: tuple[str, ...] = dataset(
        "1", "/channel", "quantity of every channel: gauge and measuring grid, or known load"
    )
    unit: tuple[str, ...] = dataset("1", "/channel", "unit of the readings of every channel")
    bridge: tuple[str, ...] = dataset("1", "/channel", "bridge arrangement of every channel; empty: no bridge")
    gauge_factor: np.ndarray = dataset("1", "/channel", "gauge factor of every channel; NaN: no bridge")
    poisson_ratio: np.ndarray = dataset("1", "/channel", "Poisson's ratio in the bridge equation; NaN: not needed")
    sign: np.ndarray = dataset("1", "/channel", "polarity of every channel; −1: reversed wiring")
    scale: np.ndarray = dataset("1", "/channel", "factor on the calibrated signal of every channel")
    offset: np.ndarray = dataset(
        "unit in /source/unit", "/channel", "zero offset of every channel, subtracted from its readings"
    )
    drift: np.ndarray = dataset(
        "unit in /source/unit, per second",
        "/channel",
        "drift rate of every channel; drift rate × time since the first sample is subtracted from the readings",
    )
    zero: np.ndarray = dataset(
        "s",
        "/channel × 2",
        "zero interval [from, to] of every channel; the mean reading in the interval is subtracted from the "
        "readings; NaN: no zero interval",
    )
    delay: np.ndarray = dataset("s", "/channel", "time delay removed from every channel; negative: time advance")


@record
class UnknownHistories:
    """Every unknown over time."""

    estimate: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "filtered estimate of <name>")
    std: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "standard deviation of the filtered <name>")
    smoothed: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "smoothed estimate of <name>")
    smoothed_std: dict[str, np.ndarray] = dataset(
        "unit of <name>", "/time", "standard deviation of the smoothed <name>"
    )
    posterior: dict[str, Posterior] = group(unit="unit of <name>", what="<name>")
    compared: Compared | None = group(default=None)
    budget: Budget | None = group(default=None)


@record
class Estimated(UnknownHistories):
    """estimate.h5 of a placement."""

    time: np.ndarray = dataset("s", "/time", "times of the estimates, on the time axis of the test file")
    gauge: TestChannels = group()
    whitened: np.ndarray = dataset(
        "1",
        "/gauge/time × /gauge/label",
        "innovations of every channel, divided by σ of the innovation; white noise if model and measurements are consistent",
        path="/consistency/whitened",
    )
    hold_out: HoldOut | None = group(default=None)
    trusted: bool = dataset(
        "1",
        "",
        "1 if the measurements are consistent with the model; otherwise the standard deviations are not reliable",
    )
    check: ChannelsChecked = group(path="/channel_check")
    bias: ChannelOffsets | None = group(default=None)
    resultant: dict[str, Resultant] = group()
    virtual: VirtualStrain | None = group(default=None)
    known: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "measured known load <name>")
    moment: SurfaceMoment | None = group(default=None)
    source: TestSource = group()
    damage: Damaged | None = group(default=None)
    notes: tuple[str, ...] = dataset("1", "sentence", "sentences on corrections of the measurements, and warnings")


@record
class CampaignRecord:
    """Results common to several records; those of each record are in /record/NAME."""

    name: tuple[str, ...] = dataset("1", "/records", "names of the test records, in config order", path="/records")
    alone: dict[str, np.ndarray] = dataset("unit of <name>", "/records", "estimate of <name> from each record alone")
    gain: float = dataset(
        "1",
        "",
        "logarithm of the likelihood ratio of two models: common parameters and gauge errors for all records, against separate "
        "parameters and gauge errors for each record",
    )
    posterior: dict[str, Posterior] = group(unit="unit of <name>", what="<name>")
    damage: Damaged | None = group(default=None)


def record_group(name: str) -> str:
    """Group of a record of a campaign."""
    return f"/record/{name}"


def campaign_in(source: File) -> CampaignRecord | None:
    """Common results of several records in estimate.h5; None for a single record."""
    return read(CampaignRecord, source) if "/records" in source else None


def estimated_in(source: File) -> dict[str, Estimated]:
    """Records of estimate.h5 by name, in order; a single record has an empty name."""
    campaign = campaign_in(source)
    if campaign is None:
        return {"": read(Estimated, source)}
    return {name: read(Estimated, source, record_group(name)) for name in campaign.name}
