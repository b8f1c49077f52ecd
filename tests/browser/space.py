"""The 3D view of a page in the hands of a person: dragged, zoomed, turned by keys, its gauges picked."""

from __future__ import annotations

import io
import re
from pathlib import Path

import h5py
import numpy as np
from PIL import Image
from playwright.sync_api import Locator, Page

from .opened import Opened

Gauge = tuple[str, np.ndarray, np.ndarray, int]
"""Label, position (3,) [m], direction (3,), element id, as the artefact has them."""

PLACES = "all => all.map(e => [Number(e.dataset.x), Number(e.dataset.y)])"
STILL = """() => new Promise(done => {
  // Over once the projected tags stood still for some frames: whatever turned has arrived, and the last picture is drawn.
  let last = '', same = 0;
  const look = () => {
    const now = [...document.querySelectorAll('#space-view .tag')].map(e => e.style.transform).join();
    same = now === last ? same + 1 : 0;
    last = now;
    same > 5 ? done(true) : requestAnimationFrame(look);
  };
  look();
})"""


def gauges_of(folder: Path) -> list[Gauge]:
    """The layout of a placement, from place.h5 by h5py alone."""
    with h5py.File(folder / "place.h5") as place:
        final = {key: place[f"selected/final/{key}"][()] for key in ("position", "direction", "element")}
    return [
        (f"G{i + 1}", *entry)
        for i, entry in enumerate(zip(final["position"], final["direction"], final["element"].tolist(), strict=True))
    ]


def gauges_of_bench(folder: Path, sensor: str) -> list[Gauge]:
    """The placed gauges of a bench, from its place.h5: places in space, of no element."""
    with h5py.File(folder / "place.h5") as place:
        placed = [place[f"layouts/place/{key}"][()] for key in ("position", "direction")]
    return [(f"{sensor} {i}", x, d, 0) for i, (x, d) in enumerate(zip(*placed, strict=True), start=1)]


def view(found: Opened) -> Locator:
    """The 3D view, on the screen and drawn."""
    host = found.page.locator("#space-view")
    host.scroll_into_view_if_needed()
    assert host.get_attribute("data-ready") == "true"
    return host


def picture(found: Opened) -> np.ndarray:
    """Pixels (height, width, 3) of what the view draws now, without the tags and axes that lie upon it."""
    found.page.evaluate(STILL)
    alone = "#space-view > :not(canvas) { visibility: hidden !important }"
    png = found.page.locator("#space-view canvas").screenshot(style=alone)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that differ by more than what rounding explains."""
    return float(np.mean(np.abs(after - before).max(axis=2) > 24))


def centre(host: Locator) -> tuple[float, float]:
    box = host.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def shows_a_structure(found: Opened) -> None:
    """More than a ground of one colour is drawn: the solid covers a good part of the view, in many shades."""
    view(found)
    pixels = picture(found)
    ground = pixels[2, 2]
    drawn = np.abs(pixels - ground).max(axis=2) > 24
    assert 0.02 < drawn.mean() < 0.9
    assert len(np.unique(pixels[drawn], axis=0)) > 20


def turns_under_the_mouse(found: Opened) -> None:
    """A drag turns the structure; the same drag back restores the picture."""
    x, y = centre(view(found))
    y += 60  # off the tags
    first = picture(found)
    mouse = found.page.mouse
    for start, end, differs in (((x, y), (x + 150, y + 40), True), ((x, y), (x - 150, y - 40), False)):
        mouse.move(*start)
        mouse.down()
        mouse.move(*end, steps=8)
        mouse.up()
        assert (changed(first, picture(found)) > 0.01) is differs


def zooms_by_the_wheel(found: Opened) -> None:
    """Before a click into the view the wheel scrolls the page; after it the wheel zooms in and out, and the page stays."""
    page = found.page
    x, y = centre(view(found))
    first, wide = picture(found), spread(found)
    at = page.evaluate("document.activeElement.blur(), scrollY")
    page.mouse.move(x, y + 60)
    page.mouse.wheel(0, 50)
    page.wait_for_function("at => scrollY > at", arg=at)
    assert spread(found) == wide
    x, y = centre(view(found))
    page.mouse.click(x, y + 60)
    at = page.evaluate("scrollY")
    page.mouse.wheel(0, -300)
    assert changed(first, picture(found)) > 0.01
    assert spread(found) > 1.2 * wide
    page.mouse.wheel(0, 300)
    assert changed(first, picture(found)) < 0.02
    assert page.evaluate("scrollY") == at


def spread(found: Opened) -> float:
    found.page.evaluate(STILL)
    places = found.page.locator("#space-view .tag").evaluate_all(PLACES)
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def obeys_the_keyboard(found: Opened) -> None:
    """Tab reaches the view and shows where it is; arrows turn, + zooms, 0 goes back to the first picture."""
    page, host = found.page, view(found)
    first = picture(found)
    host.focus()
    assert page.evaluate("document.activeElement.id") == "space-view"
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+Tab")
    assert host.evaluate("e => getComputedStyle(e).outlineStyle") != "none"
    for keys in (["ArrowLeft"] * 4, ["ArrowUp"] * 4, ["+"] * 3):
        before = picture(found)
        for key in keys:
            page.keyboard.press(key)
        assert changed(before, picture(found)) > 0.005
    page.keyboard.press("0")
    assert changed(first, picture(found)) < 0.02


def picked(page: Page) -> dict[str, list[str]]:
    said: dict[str, list[str]] = {}
    for name, text in page.locator("#space-picked dl").evaluate(
        "list => [...list.querySelectorAll('dt')].map(e => [e.textContent, e.nextElementSibling.textContent])"
    ):
        said.setdefault(name, []).append(text)
    return said


def numbers(text: str) -> list[float]:
    """The decimal numbers in a text of the page, whose minus is the typographic one."""
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text.replace("−", "-"))]


def tells_of(page: Page, label: str, position: np.ndarray, direction: np.ndarray, element: int) -> None:
    """The panel names this gauge, with the position [m] and the direction of the artefact, to the digits shown."""
    said = picked(page)
    assert said["gauge"] == [label]
    np.testing.assert_allclose(numbers(said["position"][0])[:3], position, atol=1e-4 * max(1.0, np.abs(position).max()))
    np.testing.assert_allclose(numbers(said["direction"][0]), direction, atol=6e-5)
    assert said.get("element") == ([str(element)] if element else None)


def picks_gauges(found: Opened, gauges: list[Gauge]) -> None:
    """Every gauge by its chip, by its tag in the view, and by its place on the structure: each time the same is told of it."""
    page, host = found.page, view(found)
    assert [label for label, *_ in gauges] == page.locator("button.chip").evaluate_all(
        "all => all.map(e => e.dataset.gauge)"
    )
    chip, tag = 'button.chip[data-gauge="{}"]', '#space-view .tag[data-gauge="{}"]'
    for gauge in gauges:
        page.locator(chip.format(gauge[0])).click()
        tells_of(page, *gauge)
        assert page.locator(chip.format(gauge[0])).get_attribute("aria-pressed") == "true"
        assert page.locator('button.chip[aria-pressed="true"]').count() == 1
    for gauge in gauges:
        page.evaluate(STILL)
        page.locator(tag.format(gauge[0])).dispatch_event("click")
        tells_of(page, *gauge)
    for gauge in gauges:
        page.locator('#space button[data-eye="home"]').click()
        page.evaluate(STILL)
        page.locator(chip.format(gauge[0])).click()  # turns it to the front
        page.evaluate(STILL)
        x, y = apart(found, host, tag.format(gauge[0]))
        page.evaluate("document.querySelector('#space-picked').replaceChildren()")
        page.mouse.click(x, y)
        tells_of(page, *gauge)


def apart(found: Opened, host: Locator, tag: str) -> tuple[float, float]:
    """Zoom to a gauge until the others are well away; its place on the screen [px]."""
    page = found.page
    host.focus()  # which may scroll the page
    box = host.bounding_box()
    for _ in range(20):
        others = page.locator(f"#space-view .tag:not({tag})").evaluate_all(PLACES)
        ((x, y),) = page.locator(tag).evaluate_all(PLACES)
        if not others or np.linalg.norm(np.subtract(others, [x, y]), axis=1).min() > 80:
            break
        page.mouse.move(box["x"] + x, box["y"] + y)
        page.mouse.wheel(0, -300)
        page.evaluate(STILL)
    return box["x"] + x, box["y"] + y


def moves_in_its_shapes(found: Opened) -> None:
    """Each shape of the list, its first mode at least, draws the structure in another form; at rest it is as before."""
    page, _ = found.page, view(found)
    choice = page.locator("#space-shape")
    options = choice.locator("option").evaluate_all("all => all.map(e => [e.value, e.textContent])")
    assert options[0][1] == "undeformed body"
    assert len(options) > 1
    first = picture(found)
    for value, _ in options[1:3]:
        choice.select_option(value)
        page.wait_for_timeout(100)
        assert changed(first, picture(found)) > 0.002
    choice.select_option(options[0][0])
    page.wait_for_timeout(100)
    assert changed(first, picture(found)) == 0


def shows_strain(found: Opened) -> None:
    """Every contour of the list colours the surface and brings its own scale, in µm/m or MPa; the undeformed body has none."""
    page, _ = found.page, view(found)
    choice, bars = page.locator("#space-shape"), page.locator("#space-bars > div")
    states = bars.evaluate_all("all => all.map(e => e.dataset.state)")
    assert states
    choice.select_option("-1")
    plain = picture(found)
    assert page.locator("#space-bars > div:visible").count() == 0
    for state in states:
        choice.select_option(state)
        assert changed(plain, picture(found)) > 0.02
        shown = page.locator("#space-bars > div:visible")
        assert shown.evaluate_all("all => all.map(e => e.dataset.state)") == [state]
        assert re.search(r"from (≤\xa0)?\S+ to (≥\xa0)?\S+ (µm/m|MPa)$", shown.locator(".scale").get_attribute("aria-label"))
    choice.select_option("-1")
    assert changed(plain, picture(found)) == 0
