"""The first screen of a placement beside its artefacts, which are read here with h5py alone: no number is left unexplained."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.stats

from .numbers import Number, in_words, rounded
from .opened import Opened

FIRST_SCREEN = "#in-short data, #answer data:not(#space data)"
TABLES = ", ".join(f'[data-table="{name}"] data' for name in ("gauges", "gauges: readings", "simulated test"))
WHERE = """selector => [...document.querySelectorAll(selector)].map(data => {
  const tile = data.closest('.tile'), cell = data.closest('td'), term = data.closest('dd')?.previousElementSibling;
  const words = element => element.textContent.trim().replace(/\\s+/g, ' ');
  const place = data.closest('#in-short') ? ['sentence']
    : tile ? [words(tile.querySelector('.name')), term ? words(term) : data.closest('.value') ? 'value' : 'verdict']
    : cell ? [words(cell.parentNode.cells[0]), words(cell.closest('table').tHead.rows[0].cells[cell.cellIndex])]
    : data.closest('.key') ? ['key'] : data.closest('.warnings') ? ['warnings'] : [data.parentNode.outerHTML];
  return [place, data.value, data.textContent];
})"""


def shown(
    found: Opened, selector: str = FIRST_SCREEN, wanted: Collection[tuple[str, ...]] = ()
) -> dict[tuple[str, ...], list[float]]:
    """Place on the page → the exact numbers there; each shows the exact one rounded. wanted: only these places, if any."""
    numbers: dict[tuple[str, ...], list[float]] = {}
    for place, value, text in found.page.evaluate(WHERE, selector):
        if wanted and tuple(place) not in wanted:
            continue
        assert rounded(Number(float(value), text, str(place))), (place, value, text)
        numbers.setdefault(tuple(place), []).append(float(value))
    return numbers


def of_artefacts(folder: Path) -> dict[tuple[str, ...], list[float]]:
    """The same from place.h5 and validate.h5, by the definitions of docs/artefacts.md."""
    with h5py.File(folder / "place.h5") as place, h5py.File(folder / "validate.h5") as validate:
        config = json.loads(validate.attrs["config"])
        chosen, told = place["summary"].attrs, validate["summary"].attrs
        names = [name.decode() for name in place["elimination/unknowns"][()]]
        gauges = len(place["selected/final/gauge"])
        found: dict[tuple[str, ...], list[Any]] = {
            ("sentence",): _sentence(place, validate, names, gauges, chosen["pool"], config["loads"]),
            ("key",): [gauges, chosen["pool"]],
        }
        for name in names:
            scale = place[f"expected_std/{name}"].attrs["scale"]
            absolute = place[f"expected_std/{name}"][()]
            expected = absolute / scale
            load = name in config["loads"]
            tile = f"{name}, {'load' if load else 'parameter'}"
            found[tile, "value"] = [expected]
            found[tile, "error in the simulated test"] = [told[f"error.{name}"]]
            found[tile, "± expected σ"] = [absolute]
            if told.get(f"identified.{name}", True):
                found[tile, "verdict"] = [_decisive(validate, name, load)[0]]
        found["gap of the criterion tr(W P) to its lower bound", "value"] = [max(chosen["gap"], 0.0)]
    return {where: [float(value) for value in values] for where, values in found.items()}


def of_tables(folder: Path) -> dict[tuple[str, ...], list[float]]:
    """Numbers in the tables of gauges and of the simulated test, from the same artefacts."""
    with h5py.File(folder / "place.h5") as place, h5py.File(folder / "validate.h5") as validate:
        loads, told = json.loads(validate.attrs["config"])["loads"], validate["summary"].attrs
        found: dict[tuple[str, ...], list[Any]] = {}
        for name in (name.decode() for name in place["elimination/unknowns"][()]):
            truth, absolute = validate[f"truth/{name}"][()], place[f"expected_std/{name}"]
            found[name, "true value, RMS"] = [np.sqrt(np.mean(truth**2)) if name in loads else truth[-1]]
            found[name, "estimate, RMS"] = [told[f"estimate.{name}"]]
            found[name, "error"], found[name, "claimed σ"] = [told[f"error.{name}"]], [told[f"std.{name}"]]
            if name in loads:
                found[name, "error, smoothed"] = [told[f"smoothed.{name}"]]
            column = f"expected σ({name}) without gauge"
            for i, value in enumerate(place[f"without/{name}"][()]):
                found[f"G{i + 1}", column] = [value]
            found["all gauges", column] = [absolute[()] / absolute.attrs["scale"], absolute[()]]
        for i, position in enumerate(place["selected/final/position"][()]):
            for axis, value in zip("xyz", position, strict=True):
                found[f"G{i + 1}", f"{axis} [m]"] = [value]
    return {where: [float(value) for value in values] for where, values in found.items()}


def _sentence(place: h5py.File, validate: h5py.File, names: list[str], gauges: int, pool: int, loads: Any) -> list[float]:
    """What does not hold: ratio, the most where σ holds, error; then how many gauges of how many, and σ of what holds."""
    told, wrong, right = validate["summary"].attrs, [], []
    for name in names:
        ratio, high = _decisive(validate, name, name in loads)
        if ratio > high:
            wrong += [ratio, high, told[f"error.{name}"]]
        elif told.get(f"identified.{name}", True):
            right.append(place["summary"].attrs[f"std.{name}"])
    return [*wrong, gauges, pool, *right]


def _decisive(validate: h5py.File, name: str, load: bool) -> tuple[float, float]:
    """RMS of error over σ of the test, the smoothed load and the repeats, of the one that is furthest beyond its band of χ²,
    which is no narrower than a tenth; and the upper edge of that band."""
    told = validate["summary"].attrs
    draws = [(told[f"error.{name}"], told[f"std.{name}"], told[f"draws.{name}"])]
    draws += [(told[f"smoothed.{name}"], told[f"smoothed_std.{name}"], told[f"smoothed_draws.{name}"])] * load
    repeats = validate[f"repeats/error/{name}"][()], validate[f"repeats/std/{name}"][()]
    draws.append((*repeats, len(repeats[0])))
    ratios = []
    for error, std, n in draws:
        z = np.atleast_1d(error) / np.atleast_1d(std)
        low, high = np.sqrt(scipy.stats.chi2.ppf([0.00135, 0.99865], n) / n)
        low, high = min(low, 1 / 1.1), max(high, 1.1)
        ratio = np.sqrt(np.mean(z**2))
        ratios.append((ratio / high if ratio > high else 0.0, low / ratio if ratio < low else 0.0, ratio, high))
    return max(ratios, key=lambda found: found[:2])[2:]


def opens_with_the_numbers_of_the_artefacts(found: Opened) -> None:
    """Every number of the first screen is that of the artefact in its place, and there is no other."""
    expected, on_page = of_artefacts(found.file.parent), shown(found)
    assert set(on_page) == set(expected)
    in_tables = of_tables(found.file.parent)
    on_page |= shown(found, TABLES, in_tables)
    for place, values in (expected | in_tables).items():
        assert on_page[place] == pytest.approx(values, rel=1e-12, abs=0), place


def has_no_other_digit(found: Opened, *names: str) -> None:
    """Beside the numbers no digit stands on the first screen but in labels of gauges and in these names."""
    for selector in ("#in-short", "#answer"):
        text, _ = in_words(found.page, selector)
        for name in (*names, *re.findall(r"\bG\d+\b", text)):
            text = text.replace(name, "")
        assert not re.search(r"\d", text), text


def sentence(found: Opened) -> list[Number]:
    """The numbers of the sentence under the title, in order; each shows the exact one rounded, and no digit stands beside."""
    text, numbers = in_words(found.page, "#in-short")
    assert not re.search(r"\d", text), text
    for number in numbers:
        assert rounded(number), number
    return numbers


def rows(found: Opened, selector: str) -> list[tuple[str, list[float]]]:
    """Text and exact numbers of the rows of the tables in that element."""
    told = found.page.locator(f"{selector} tbody tr").evaluate_all(
        "all => all.map(e => [e.innerText, [...e.querySelectorAll('data')].map(data => data.value)])"
    )
    return [(text, [float(value) for value in values]) for text, values in told]
