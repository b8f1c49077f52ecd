"""Which gauge a channel of a test means: by its name, which has to stand for the place where it was bonded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import ConfigError, blame, did_you_mean
from strainsight.experiment.layout.names import layout_labels
from strainsight.experiment.structure.bonded_file import BondedPlace, read_bonded
from strainsight.records.training import Training
from strainsight.sensors.candidates import STRAIN, Candidates

KEY = "estimate.gauges_file"
ROUNDED = 1e-6
"""Of a position and of a direction: what a file with nine digits may be off by, where nothing is tolerated."""


def bonded_gauges(config: PlacementConfig, training: Training, layout: np.ndarray, file: Path | None) -> dict[str, int]:
    """Numbers of the gauges that the channels of `estimate` are of, by name.

    layout (k,): numbers of the gauges of the layout; file: that of `estimate.gauges_file`, None where it names none. Names of the
    config stand for their places. G1, G2, … are those of the layout as it is now: they have to be where the file says that they
    were bonded, within one σ of place and of direction (`tolerances`).

    Raises ConfigError for a gauge that is not there or sits elsewhere now, and where it is not said where it was bonded.
    """
    assert config.estimate is not None
    named = {name: i for i, name in enumerate(training.name) if name}
    placed = dict(zip(layout_labels(training.name, layout), layout.tolist(), strict=True))
    places = None
    if file is not None:
        _check_kept(file)
        with blame(KEY):
            places = read_bonded(file)
    found = {}
    for i, entry in enumerate(config.estimate.channels):
        name, key = str(entry.gauge), f"estimate.channels.{i}.gauge"
        if name not in named and name not in placed:
            raise absent(key, name, [*placed, *named], places)
        found[name] = number = named[name] if name in named else placed[name]
        if name in named:
            continue
        if places is None and not config.estimate.as_placed:
            raise place_unknown(name)
        if places is not None:
            _check_place(config, key, name, training.candidates, number, places)
    return found


def _check_kept(file: Path) -> None:
    """Raises ConfigError for the gauges.csv of results, which `place` replaces with every layout."""
    if file.name == "gauges.csv" and (file.parent / "place.h5").is_file():
        raise ConfigError(
            f"{file.name} of results is written anew with every layout: it does not say where gauges were bonded",
            key=KEY,
            remedy="copy the one by which they were bonded beside the config, and name the copy; former ones stay in the results "
            "as gauges-….csv",
        )


def place_unknown(name: str) -> ConfigError:
    """Of a gauge of the layout, which is placed anew by every run."""
    return ConfigError(
        f"{name} is the name of a place in the layout as it is now, and nothing says where it was bonded",
        key=KEY,
        remedy="keep gauges.csv of the results beside the config when gauges are bonded, and name it: "
        "estimate.gauges_file: gauges.csv; or set estimate.as_placed: true where the layout is sure to be the same",
    )


def absent(key: str, name: str, there: Sequence[str], places: Mapping[str, BondedPlace] | None = None) -> ConfigError:
    """Of a channel of a gauge that is not among those that are there."""
    listed = list(dict.fromkeys(there))
    known = f"there are {', '.join(listed[:12])}{' …' * (len(listed) > 12)}"
    if places is not None and name in places:
        was = f": it was bonded at {_xyz(places[name].position)} m"
        return ConfigError(f"the layout has no gauge '{name}' now{was}", key=key, remedy=_KEPT)
    return ConfigError(
        f"no gauge '{name}'", key=key, remedy=" ".join(filter(None, (did_you_mean(name, listed), known)))
    )


_KEPT = "bonded gauges stay in every layout, under their names, with gauges.fixed_file: that file"


def not_bonded(key: str, name: str, places: Mapping[str, BondedPlace]) -> ConfigError:
    """Of a gauge that the file of the bonded ones lacks."""
    known = f"it has {', '.join(places)}"
    return ConfigError(
        f"{KEY} does not say where {name} was bonded",
        key=key,
        remedy=" ".join(filter(None, (did_you_mean(name, places), known))),
    )


def _check_place(
    config: PlacementConfig,
    key: str,
    name: str,
    candidates: Candidates,
    number: int,
    places: Mapping[str, BondedPlace],
) -> None:
    """Raises ConfigError where the gauge is not where it was bonded."""
    if name not in places:
        raise not_bonded(key, name, places)
    was, own = places[name], candidates.take(candidates.channels(np.array([number])))
    order = np.argsort(-own.sign_of_grid, kind="stable")  # the arms of a bridge as those of the file below
    now, sign, direction = own.grids.take(order), own.sign_of_grid[order], was.direction
    if len(now) != (len(was.arms) or len(was.direction)):
        what = "arms" if own.arms is not None or was.arms else "channels"
        raise ConfigError(
            f"{name} had {len(was.arms) or len(was.direction)} {what} where it was bonded, and has {len(now)} now",
            key=key,
            remedy=_KEPT,
        )
    if was.arms:
        arms = sorted(was.arms, key=lambda arm: -arm.sign)
        there, direction = np.array([arm.position for arm in arms]), np.array([arm.direction for arm in arms])
        if [arm.sign for arm in arms] != sign.tolist():
            raise ConfigError(f"the arms of {name} had other signs where it was bonded", key=key, remedy=_KEPT)
    else:
        there = np.repeat(was.position[None], len(now), axis=0)
    allowed, off = tolerances_of(config.tolerances), np.linalg.norm(now.position - there, axis=1)
    worst = int(np.argmax(off))
    moved, position = float(off[worst]), now.position[worst]
    if moved > max(allowed.position, ROUNDED * float(np.abs(was.position).max())):
        raise ConfigError(
            f"{name} sits elsewhere now: it was bonded at {_xyz(there[worst])} m, and the layout has it at {_xyz(position)} m, "
            f"{1e3 * moved:.3g} mm from there",
            key=key,
            remedy=_KEPT,
        )
    along = np.sum(now.direction * direction, axis=1)
    if own.quantity[0] == STRAIN:
        along = np.abs(along)  # a gauge that is turned by half a turn reads the same
    turned = float(np.rad2deg(np.arccos(np.clip(along.min(), -1.0, 1.0))))
    if turned > max(allowed.angle, float(np.rad2deg(np.sqrt(2 * ROUNDED)))):
        raise ConfigError(
            f"{name} is turned by {turned:.3g}° from where it was bonded, along {_xyz(direction[int(np.argmin(along))])}",
            key=key,
            remedy=_KEPT,
        )


def _xyz(x: np.ndarray) -> str:
    return f"({', '.join(f'{value:.4g}' for value in x + 0.0)})"
