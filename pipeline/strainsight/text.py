"""Numbers as people read them (four digits, SI prefixes, per cent); cells of CSV as no spreadsheet takes them for formulas."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from types import SimpleNamespace

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
READINGS = {"strain": "strain", "m/s^2": "acceleration", "m/s²": "acceleration", "m": "displacement"}
"""What a gauge reads, by the unit that the artefacts state."""
PREFIXED_UNITS = frozenset({"Pa", "N", "N·m", "Nm", "N/m", "Hz", "W", "J"})
PER_LOAD = {"N": (1e3, "kN"), "N m": (1e3, "kN m"), "Pa": (1e6, "MPa")}
"""Unit of a load → size and name of the unit for which readings are given."""
SMALL = 5e-5
"""Ratio below which it is no longer shown in per cent."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 4) -> str:
    """A plain number to `digits` significant digits: 0.05, 1207, 12 070, 2.1×10¹¹; ∞ and – for what is none."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 6:
        text = f"{value:.{max(digits - 1 - power, 0)}f}" if power < digits else _grouped(f"{round(value)}")
        text = text.rstrip("0").rstrip(".") if "." in text else text
        return text.replace("-", "−")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}×10{str(power).translate(SUPERSCRIPTS)}".replace("-", "−", 1)


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A number with its unit, prefixed where engineers do: 209.9 GPa, 10 kN, 7850 kg/m³; a factor, of unit 1, alone."""
    factor, prefixed = prefix(abs(value), unit)
    return number(value, digits) if unit in ("", "1") else f"{number(value / factor, digits)}\u00a0{prefixed}"


def prefix(size: float, unit: str) -> tuple[float, str]:
    """The factor and the prefixed unit in which numbers of this size are between 1 and 1000."""
    return _prefixed(size, unit, 12) if unit in PREFIXED_UNITS else (1.0, unit)


def _prefixed(size: float, unit: str, largest: int) -> tuple[float, str]:
    """largest: power of ten of the largest prefix."""
    if not 0 < size < math.inf:
        return 1.0, unit
    power = min(max(3 * math.floor(math.log10(size * (1 + 1e-12)) / 3), -9), largest)
    return 10.0**power, PREFIXES[power] + unit


def reading_unit(size: float, unit: str) -> tuple[float, str]:
    """The factor and the unit in which readings of this size are shown: strain in µm/m, displacements from nm to m."""
    if unit == "strain":
        return 1e-6, "µm/m"
    return _prefixed(size, unit, 0) if unit == "m" else prefix(size, unit.replace("^2", "²"))


def percent(ratio: float, digits: int = 2) -> str:
    """A ratio in per cent with its trailing zeros: 0.0010 → 0.10 %; below a half of the last thousandth: 0.000 %."""
    if math.isinf(ratio):
        return "∞"
    if math.isnan(ratio):
        return "–"
    value = 100 * ratio
    if abs(value) < 5e-4:
        return "0.000\u00a0%"
    power = int(f"{value:.{digits - 1}e}".split("e")[1])
    if power >= 6:
        return f"{number(value, digits)}\u00a0%"
    rounded = round(value, digits - 1 - power)
    return _grouped(f"{rounded:.{max(digits - 1 - power, 0)}f}").replace("-", "−") + "\u00a0%"


def ratio(value: float, digits: int = 2) -> str:
    """A ratio in per cent, or as a plain number where per cent would be a row of zeros."""
    return number(value, digits) if 0 < abs(value) < SMALL else percent(value, digits)


def _grouped(digits: str) -> str:
    """Thin spaces between thousands, from five digits on."""
    return f"{int(digits):,}".replace(",", "\u202f") if len(digits.lstrip("-")) > 4 and "." not in digits else digits


def unbroken(text: str) -> str:
    """Text in which no line ends between a number and its per cent or millimetres."""
    return re.sub(r"(?<=\d) (?=%|mm\b|m\b|s\b|Hz\b)", "\u00a0", text)


def listed(words: Sequence[str]) -> str:
    """ "x", "x and y", "x, y and z"."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def capital(text: str) -> str:
    """A sentence with a capital letter, where it does not begin with a symbol: σ stays σ."""
    return text[:1].upper() + text[1:] if text[:1].isascii() else text


def short(name: str, length: int = 20) -> str:
    """A name that fits into a figure: cut after `length` characters, in one line."""
    line = " ".join(name.split())
    return line if len(line) <= length else line[: length - 1] + "…"


FORMULA = "=+-@\t\r\n＝＋－＠"
"""What a formula begins with, in one spreadsheet or another. Source: OWASP, "CSV injection"."""
MARK = "'"
"""In front of a text that begins like a formula, or with a mark: spreadsheets take the cell for text."""
_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|inf|nan)", re.ASCII)


def csv_bytes(rows: Iterable[Sequence[str]]) -> bytes:
    """The lines of a table in UTF-8; `plain_cell` undoes what is done to a cell."""
    lines: list[str] = []
    # a cell that holds a sign of the end of lines is put in quotes
    writer = csv.writer(SimpleNamespace(write=lines.append), lineterminator="\r\n")
    writer.writerows([safe_cell(cell) for cell in row] for row in rows)
    return "".join(line.removesuffix("\r\n") + "\n" for line in lines).encode(errors="replace")


def safe_cell(cell: str) -> str:
    """A text as it is written; numbers are left as they are."""
    marked = cell[:1] in FORMULA + MARK and cell and not _NUMBER.fullmatch(cell)
    return MARK + cell if marked else cell


def plain_cell(cell: str) -> str:
    """A text as it was before `safe_cell`."""
    return cell[1:] if cell[:1] == MARK and cell[1:2] and cell[1] in FORMULA + MARK else cell


_SHORT_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]?([+-]?\d+)")


def parse_real(token: str) -> float | None:
    """A finite real in any form of Fortran (1.7E-4, 1.7D-4, 1.7-4), or None."""
    if "_" in token or not token:
        return None
    try:
        value = float(token)
    except ValueError:
        if not (short := _SHORT_REAL.fullmatch(token)):
            return None
        value = float(f"{short[1]}e{short[2]}")
    return value if math.isfinite(value) else None
