"""Contents of a test data file, as written, and the units of its channels."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from strainsight.errors import UserError, did_you_mean

MOST_SAMPLES = 200_000_000
"""Limit of one channel, 5.5 hours at 10 kHz."""
DAMAGED = "export the test data again: the file is damaged or empty"
Signals = Iterator[tuple[np.ndarray, str | None]]
"""Values (T,) and their unit, None if the file has none."""
Read = Callable[[Path, Sequence[Any]], Signals]
"""File, names → their signals; the first name is the time, None if the format has an implicit time."""


@dataclass(frozen=True)
class Recording:
    """Channels of one file on one clock.

    time (T,) [s], finite, order not yet checked; channels: requested name → (T,) in the unit of the file, NaN for
    missing samples; units: name → unit in the file, None if missing. source: the file. lines (k, 2): sample from 0 and
    its line in the file; between two entries each sample is on the next line. Empty if the file has no lines."""

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str | None]
    source: str
    lines: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            if values.shape != self.time.shape:
                raise UserError(
                    f"channel {name!r} has {values.size} samples, but the time axis has {self.time.size}",
                    where=self.source,
                    remedy="use channels with the same sampling times",
                )
        if self.time.size < 2:
            raise UserError(
                f"the record has {'only one sample' if self.time.size else 'no samples'}",
                where=self.source,
                remedy="use a record with at least two samples",
            )

    def place(self, sample: int) -> str:
        """ "file:line" of a sample from 0, or "file, sample 12" (from 1) if the file has no lines."""
        if not len(self.lines):
            return f"{self.source}, sample {sample + 1}"
        run = self.lines[np.searchsorted(self.lines[:, 0], sample, side="right") - 1]
        return f"{self.source}:{run[1] + sample - run[0]}"


def quote(text: str, most: int = 40) -> str:
    """A piece of a file for a message: quoted, shortened, and without control characters."""
    cut = text if len(text) <= most else text[: most - 1] + "…"
    return "'" + "".join(sign if sign.isprintable() else "?" for sign in cut) + "'"


def missing_error(
    kind: str, name: str, known: Collection[str], where: str, shown: Collection[str] | None = None
) -> UserError:
    """Error for a missing `kind` of this name; shown: known names to list in the remedy, by default all."""
    listed = [quote(each) for each in dict.fromkeys(known if shown is None else shown)]
    has = (
        f"the file contains {', '.join(listed[:20])}{' …' * (len(listed) > 20)}"
        if listed
        else f"the file contains no {kind}s"
    )
    return UserError(f"{kind} {name!r} not found", where=where, remedy=did_you_mean(name, known, has))


def check_count(samples: int, name: str, where: str) -> None:
    """Raise UserError for a channel with more samples than MOST_SAMPLES."""
    if samples > MOST_SAMPLES:
        raise UserError(
            f"channel {name!r} has {samples} samples according to the file, more than the limit of {MOST_SAMPLES}",
            where=where,
            remedy="shorten the record",
        )


def check_no_infinity(values: np.ndarray, name: str, where: str) -> None:
    """Raise UserError for a channel (T,) with an infinite sample."""
    if (infinite := np.isinf(values)).any():
        raise UserError(
            f"sample {int(np.argmax(infinite)) + 1} of channel {name!r} is infinite",
            where=where,
            remedy="write NaN for missing samples",
        )


def one_unit(units_in_file: Sequence[str], name: str, where: str) -> str | None:
    """The unit of a channel, None if it has none. Raises UserError for different units."""
    words = sorted({word.strip() for word in units_in_file} - {""})
    if len(words) > 1:
        raise UserError(
            f"channel {name!r} has several units: {' and '.join(map(quote, words))}",
            where=where,
            remedy="keep only the correct unit in the file",
        )
    return words[0] if words else None


def decode(line: bytes) -> str:
    """Text in UTF-8 or else Windows-1252."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading bytes. Raises UserError if it is missing, empty, or not a file."""
    try:
        if not path.is_file():
            raise UserError(
                "the path is not a file" if path.exists() else "file not found",
                where=str(path),
                remedy="correct the name; a relative path is relative to the folder of the config file",
            )
        if not path.stat().st_size:
            raise UserError("the file is empty", where=str(path), remedy="export the test data again")
        return path.open("rb")
    except (OSError, ValueError) as error:
        raise UserError(
            f"the file cannot be read: {error}", where=str(path), remedy="check that the file is readable"
        ) from None


STANDARD_GRAVITY = 9.80665
"""[m/s²]."""
_POUND = 0.45359237 * STANDARD_GRAVITY


class Unit(NamedTuple):
    """quantity: strain, bridge (output over excitation [V/V]), acceleration …; factor: SI value of one unit."""

    quantity: str
    factor: float


_TABLE: Mapping[str, Mapping[str, float]] = {
    "strain": {
        **dict.fromkeys(("strain", "m/m", "mm/mm", "in/in", "inch/inch", "ε"), 1.0),
        **dict.fromkeys(
            ("um/m", "uin/in", "ppm", "microstrain", "ustrain", "uε", "ue", "microepsilon", "uepsilon"), 1e-6
        ),
        **dict.fromkeys(("mm/m", "um/mm", "millistrain", "mstrain", "mε", "‰"), 1e-3),
        **dict.fromkeys(("nm/m", "nanostrain", "nstrain", "nε"), 1e-9),
        "%": 1e-2,
    },
    "bridge": {"V/V": 1.0, "mV/V": 1e-3, "uV/V": 1e-6},
    "acceleration": {
        "m/s2": 1.0,
        "mm/s2": 1e-3,
        "cm/s2": 1e-2,
        "g": STANDARD_GRAVITY,
        "mg": 1e-3 * STANDARD_GRAVITY,
        "in/s2": 0.0254,
        "ft/s2": 0.3048,
    },
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048},
    "force": {
        **dict.fromkeys(("N", "newton", "newtons"), 1.0),
        "mN": 1e-3,
        "daN": 10.0,
        "kN": 1e3,
        "MN": 1e6,
        **dict.fromkeys(("lbf", "lb", "lbs", "pound", "pounds", "pound-force"), _POUND),
        "kip": 1e3 * _POUND,
        "kgf": STANDARD_GRAVITY,
    },
    "moment": {"Nm": 1.0, "Nmm": 1e-3, "kNm": 1e3, "MNm": 1e6, "lbfft": _POUND * 0.3048, "lbfin": _POUND * 0.0254},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6, "in/s": 0.0254, "ft/s": 0.3048},
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180, "°/s": math.pi / 180, "rpm": math.pi / 30},
    "ratio": {"1": 1.0},
    "angular velocity squared": {"rad2/s2": 1.0, "1/s2": 1.0},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": _POUND / 0.0254**2},
}
UNITS: Mapping[str, Unit] = {
    spelt: Unit(quantity, factor) for quantity, row in _TABLE.items() for spelt, factor in row.items()
}
"""All units in the form of `spelling`."""
SIGN = 4
"""Largest length of a unit symbol; longer units are words."""
SI: Mapping[str, str] = {
    "strain": "m/m",
    "bridge": "m/m",
    "acceleration": "m/s²",
    "displacement": "m",
    "force": "N",
    "moment": "N m",
    "velocity": "m/s",
    "angle": "rad",
    "ratio": "1",
    "angular velocity squared": "rad²/s²",
    "pressure": "Pa",
}
"""Quantity → unit of the calibrated channel; a bridge output becomes a strain."""
TIME: Mapping[str, float] = {
    **dict.fromkeys(("s", "sec", "sec.", "second", "seconds", "sek", "sek.", "sekunde", "sekunden"), 1.0),
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
"""[s]."""


RATES: Mapping[str, float] = {"Hz": 1.0, "kHz": 1e3, "1/s": 1.0}
"""[1/s]."""

OTHER_NAMES: Mapping[str, str] = {
    **dict.fromkeys(("knewton", "knewtons", "kilonewton", "kilonewtons"), "kN"),
    **dict.fromkeys(("kp", "kilopond", "kg", "kgforce"), "kgf"),
    **dict.fromkeys(("mp", "tf", "tonf", "t", "ton"), "kN (1 tf is 9.80665 kN)"),
    **dict.fromkeys(("klbf", "klb", "kips"), "kip"),
    **dict.fromkeys(("newtonmeter", "newtonmetre", "newton-metre", "newton-meter", "n-m"), "N m"),
    **dict.fromkeys(("lb-ft", "ft-lb", "lbft", "ftlb", "ftlbf"), "lbf ft"),
    **dict.fromkeys(("lb-in", "in-lb", "lbin", "inlb", "inlbf"), "lbf in"),
    **dict.fromkeys(("n/mm2", "n/mm²", "mpascal"), "MPa"),
    "n/m2": "Pa",
}
"""Names of units in small letters → our name; only suggested, because t may be a mass."""


def spelling(unit: str) -> str:
    """Normalised unit: µm/m, μm/m → um/m; m/s², m/s^2, m/s**2 → m/s2; N·m, N*m, N m → Nm; without brackets."""
    text = unicodedata.normalize("NFKC", unit).replace("μ", "u").replace("ɛ", "ε").replace("^", "").replace("**", "")
    text = "".join(sign for sign in text if sign not in "*·⋅" and not sign.isspace())
    return text[1:-1] if len(text) > 2 and text[0] + text[-1] in ("[]", "()") else text


def known_unit(unit: str | None) -> Unit | None:
    """The unit, or None if it is unknown. Strains and whole words are known in any case: uStrain, Pounds."""
    spelt = spelling(unit or "")
    small = UNITS.get(spelt.lower())
    word = small is not None and (small.quantity == "strain" or (len(spelt) > SIGN and spelt.isalpha()))
    return UNITS.get(spelt, small if word else None)


def required_unit(unit: str, of: Collection[str] = ()) -> Unit:
    """The unit; UserError with a suggestion if it is unknown; of: allowed quantities, by default all."""
    if (matched := known_unit(unit)) is None:
        known = [name for name, unit_ in UNITS.items() if not of or unit_.quantity in of]
        remedy = f"known units: {', '.join(known)}"
        if meant := suggest_unit(unit):
            remedy = f"did you mean {meant}?"
        elif len(unit) > SIGN and unit.isalpha():  # symbols of similar spelling differ: mm/m is a thousandth of mm/mm
            remedy = did_you_mean(unit, [name for name in known if len(name) > SIGN and name.isalpha()], remedy)
        raise UserError(f"unknown unit {unit!r}", remedy=remedy)
    return matched


def suggest_unit(unit: str) -> str | None:
    """Correct spelling of a unit with other capitals or another name; None if there is no suggestion."""
    spelt = spelling(unit)
    same_letters = [name for name in UNITS if name.lower() == spelt.lower()]
    return OTHER_NAMES.get(spelt.lower()) or (" or ".join(same_letters) or None)


def seconds_in(unit: str) -> float | None:
    """Seconds in one unit of time, or None; whole words in any case."""
    spelt = spelling(unit)
    return TIME.get(spelt, TIME.get(spelt.lower()) if len(spelt) > 2 else None)


def time_factor(unit_in_config: str | None, unit_in_file: str | None, where: str) -> float:
    """Seconds in one unit of the time column: unit in the config, or in the file at `where`. Raises UserError if both are
    missing, different, or unknown."""
    for unit, source in ((unit_in_config, "config"), (unit_in_file, "file")):
        if unit is not None and seconds_in(unit) is None:
            raise UserError(
                f"the unit of time in the {source} is unknown: {unit!r}",
                where=where if unit is unit_in_file else None,
                remedy=did_you_mean(spelling(unit), TIME, f"known units of time: {', '.join(TIME)}"),
            )
    if unit_in_config is None and unit_in_file is None:
        raise UserError(
            "the file does not define the unit of the time",
            where=where,
            remedy="set `time: {unit: UNIT}` in the config, or write the unit into the file, as in 'time [s]'",
        )
    factors = [
        factor
        for unit in (unit_in_config, unit_in_file)
        if unit is not None and (factor := seconds_in(unit)) is not None
    ]
    if factors[0] != factors[-1]:
        raise UserError(
            f"the time unit is {unit_in_config} in the config, but {unit_in_file} in the file",
            where=where,
            remedy=f"correct the unit in the file, or set `time: {{unit: {unit_in_file}}}` in the config",
        )
    return factors[0]
