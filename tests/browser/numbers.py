"""The numbers that a page opens with, read as a person reads them and beside the exact ones it keeps."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from playwright.sync_api import Page

FACTORS = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}
UNITS = ("Pa", "N·m", "N/m", "Nm", "N", "Hz", "W", "J")
"""Units that take a prefix."""
SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
SHOWN = re.compile(r"([-+]?)(\d[\d\u202f]*(?:\.(\d+))?)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?(?:\u00a0(\S.*))?")


@dataclass(frozen=True)
class Number:
    """A `data` element: its exact value, what it shows, and where it stands."""

    value: float
    shown: str
    place: str


def in_words(page: Page, selector: str) -> tuple[str, list[Number]]:
    """The text of the first such element with its numbers taken out, a ◊ for each, and the numbers in order."""
    text, found = page.locator(selector).first.evaluate(
        """element => {
          const copy = element.cloneNode(true);
          copy.querySelectorAll('#space, .still, script').forEach(e => e.remove());
          const data = [...copy.querySelectorAll('data')];
          const numbers = data.map(e => [e.value, e.textContent]);
          data.forEach(e => { e.textContent = '◊' });
          return [copy.textContent, numbers];
        }"""
    )
    return " ".join(text.split()), [Number(float(value), shown, selector) for value, shown in found]


def rounded(number: Number) -> bool:
    """Whether what is shown is the exact value to the digits shown: with its SI prefix, in per cent, times a power of ten."""
    text = number.shown.replace("−", "-").strip()
    if not math.isfinite(number.value):
        return text in {"inf": ("∞", "cannot observe"), "-inf": ("-∞",), "nan": ("–",)}[str(number.value)]
    match = SHOWN.fullmatch(text)
    if match is None:
        return False
    sign, digits, decimals, power, unit = match.groups()
    factor = 10.0 ** int((power or "0").translate(SUPERSCRIPTS)) * scale(unit or "")
    size = float(digits.replace("\u202f", "")) * (-1 if sign == "-" else 1)
    figures = len(digits.replace("\u202f", "").replace(".", "").lstrip("0"))
    # Whole numbers of five digits and more are exact counts or rounded to four digits: 12 070 stands for 12 066 to 12 074.
    step = 10.0 ** -len(decimals or "")
    if not decimals and figures > 2:
        step = 10.0 ** max(len(digits.replace("\u202f", "")) - 4, 0)
    return abs(size * factor - number.value) <= 0.5000001 * step * factor


def scale(unit: str) -> float:
    """What a number in this unit is multiplied by to be in SI, or as a ratio."""
    if unit.startswith("%"):
        return 0.01
    for own in UNITS:
        if unit.endswith(own) and unit.removesuffix(own) in FACTORS:
            return FACTORS[unit.removesuffix(own)]
    return 1.0
