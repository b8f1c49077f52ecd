"""Tables as a person works with them: sorted by a click, copied, saved, and every number as exact as the page has it."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass

from playwright.sync_api import Locator, Page

READ = """table => {
  // Groups of rows that belong together (a tbody of several, else rows that one cell spans), each row as wide as the table.
  const bodies = [...table.tBodies].map(body => {
    const rows = [...body.rows], cells = rows.map(() => []);
    rows.forEach((row, i) => { let j = 0; for (const cell of row.cells) {
      while (cells[i][j]) j += 1;
      for (let down = 0; down < cell.rowSpan; down += 1)
        for (let right = 0; right < cell.colSpan; right += 1) cells[i + down][j + right] = cell;
      j += cell.colSpan;
    }});
    return cells;
  });
  const told = cell => [cell.innerText.trim(), cell.colSpan > 1,
    [...cell.querySelectorAll('data')].map(data => [data.value, data.innerText.trim()])];
  const groups = [];
  for (const cells of bodies) {
    let until = 0;
    cells.forEach((row, i) => {
      if (i === 0 || (bodies.length === 1 && i >= until)) groups.push([]);
      groups.at(-1).push(row.map(told));
      until = Math.max(until, ...row.map(cell => [...cell.closest('tbody').rows].indexOf(cell.parentNode) + cell.rowSpan));
    });
  }
  return groups;
}"""


@dataclass(frozen=True)
class Cell:
    """What a cell shows, the exact numbers in it, whether its words begin with the first of them or are no more than it, and
    whether it spans columns."""

    text: str
    values: tuple[float, ...]
    leading: bool
    alone: bool
    wide: bool


Group = tuple[tuple[Cell, ...], ...]
"""Rows that stay together when a table is sorted; mostly one."""


def table_named(page: Page, name: str) -> Locator:
    return page.locator(f'.scroll[data-table="{name}"] table')


def unfolded(page: Page) -> list[str]:
    """Open whatever is folded away; names of all tables that have a head."""
    page.evaluate("document.querySelectorAll('details').forEach(e => { e.open = true })")
    return page.locator(".scroll[data-table]:has(thead)").evaluate_all("all => all.map(e => e.dataset.table)")


def groups(table: Locator) -> list[Group]:
    return [tuple(tuple(_cell(*cell) for cell in row) for row in group) for group in table.evaluate(READ)]


def _cell(text: str, wide: bool, data: list[list[str]]) -> Cell:
    leading = bool(data) and text.startswith(data[0][1])
    return Cell(text, tuple(float(value) for value, _ in data), leading, leading and text == data[0][1], wide)


def key(cell: Cell) -> tuple | None:
    """Numbers by their exact value, then words as people order them, G2 before G10 and digits before letters; None for what says
    nothing."""
    if cell.wide or cell.text in ("–", ""):
        return None
    if cell.leading:
        return None if math.isnan(cell.values[0]) else (0, cell.values[0])
    parts = re.split(r"(\d+)", cell.text.casefold())
    return (1, *((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part))


def order(found: list[Group], column: int, *, falling: bool) -> list[int]:
    """Indices of the groups sorted by a column, by the smallest entry of each rising and by its largest falling; numbers
    before words and what says nothing last either way; equal ones as they stood."""
    keys = {}
    for i, group in enumerate(found):
        told = [k for row in group if (k := key(row[column])) is not None]
        if told:
            keys[i] = (max if falling else min)(told)
    numbers = sorted((i for i in keys if keys[i][0] == 0), key=lambda i: keys[i], reverse=False)
    words = sorted((i for i in keys if keys[i][0] == 1), key=lambda i: keys[i])
    if falling:
        numbers, words = (sorted(part, key=lambda i: keys[i], reverse=True) for part in (numbers, words))
    return [*numbers, *words, *(i for i in range(len(found)) if i not in keys)]


def sorts_by_every_head(table: Locator) -> int:
    """Click every head three times: rising, falling, as it was. How many columns moved anything."""
    first = groups(table)
    heads = table.locator("thead th")
    if len(first) < 2:
        assert table.locator("button.sort").count() == 0
        return 0
    moved = 0
    for column in range(heads.count()):
        states = []
        for name, wanted in (
            ("ascending", order(first, column, falling=False)),
            ("descending", order(first, column, falling=True)),
            ("none", list(range(len(first)))),
        ):
            heads.nth(column).locator("button.sort").click()
            marks = heads.evaluate_all("all => all.map(e => e.ariaSort)")
            assert marks == ["none"] * column + [name] + ["none"] * (len(marks) - column - 1)
            shown = groups(table)
            assert shown == [first[i] for i in wanted], f"column {column + 1} {name}"
            states.append(shown)
        moved += any(state != first for state in states)
    return moved


def tools(table: Locator) -> Locator:
    return table.locator("xpath=ancestor::div[contains(@class,'scroll')][1]/preceding-sibling::*[1]")


def copied(table: Locator) -> list[list[str]]:
    """What Copy puts on the clipboard, as cells."""
    page = table.page
    page.bring_to_front()
    page.evaluate("navigator.clipboard.writeText('nothing')")
    tools(table).locator('button[data-do="copy"]').click()
    tools(table).locator(".status", has_text="copied").wait_for()
    text = page.evaluate("navigator.clipboard.readText()")
    return [line.split("\t") for line in text.removesuffix("\n").split("\n")]


def saved(table: Locator) -> tuple[str, list[list[str]]]:
    """The name and the cells of the file that Save CSV downloads."""
    with table.page.expect_download() as waiting:
        tools(table).locator('button[data-do="csv"]').click()
    data = waiting.value.path().read_bytes()
    assert data.startswith(b"\xef\xbb\xbf")  # spreadsheets take a file without it for another alphabet
    text = data.decode("utf-8-sig")
    assert text.count("\r\n") == text.count("\n")
    return waiting.value.suggested_filename, list(csv.reader(io.StringIO(text, newline="")))


def exact(cells: list[list[str]], table: Locator) -> int:
    """Every number of the page's table stands with all its digits in its place among these cells, beside its unit in a column of
    several units. How many there were."""
    kept = [i for i, name in enumerate(cells[0]) if not name.endswith(", unit")]
    cells = [[row[i] for i in kept] for row in cells]
    shown = [row for group in groups(table) for row in group]
    assert {len(row) for row in cells} == {table.locator("thead th").count()}
    assert len(cells) == 1 + len(shown) + table.locator("tfoot tr").count()
    count = 0
    for row, written in zip(shown, cells[1:], strict=False):
        for cell, text in zip(row, written, strict=True):
            if key(cell) is None and not cell.wide:
                assert text == "", (cell, text)
            elif cell.alone:
                assert float(text) == cell.values[0], (cell, text)
            elif cell.values and not cell.wide:
                numbers = [float(found) for found in re.findall(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|inf)", text)]
                assert set(cell.values) <= set(numbers), (cell, text)
            count += len(cell.values)
    return count


def works(table: Locator, run: str, name: str) -> None:
    """Sorted by every head, copied, and saved under the run's and the table's name, with exact numbers."""
    sorts_by_every_head(table)
    lines = copied(table)
    numbers = exact(lines, table)
    file, cells = saved(table)
    assert file == "-".join((run, re.sub(r"[^\w.-]+", "-", name))) + ".csv"
    assert exact(cells, table) == numbers
    # After a sort the file has the order shown, so that what is seen is what is kept.
    if len(groups(table)) > 1:
        table.locator("thead th button.sort").last.click()
        table.locator("thead th button.sort").last.click()
        exact(copied(table), table)
        table.locator("thead th button.sort").last.click()


def all_work(page: Page, run: str) -> list[str]:
    found = unfolded(page)
    assert len(found) == len(set(found))
    for name in found:
        works(table_named(page, name), run, name)
    return found
