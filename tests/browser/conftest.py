"""The browser that opens the pages: Debian's chromium, headless, drawing WebGL in software."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, sync_playwright

pytest.register_assert_rewrite(*(f"{__package__}.{name}" for name in ("answers", "checks", "every", "space", "tables")))

from .opened import Opened, opened  # noqa: E402

FLAGS = (
    "--no-sandbox",  # root may not have one
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",  # WebGL, in software
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
NAMES = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser a file; its event loop must not stay open for the tests of other files."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no chromium on this machine: apt-get install chromium")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield running
        running.close()


@pytest.fixture
def look(browser) -> Iterator[Callable[..., Opened]]:
    """look(file, width=1280, height=900, scheme="light", touch=False, scripts=True, still=False) → the page as opened from
    the disk, closed after the test; still: by someone who has asked the machine for less motion."""
    contexts = []

    def open_it(
        file: Path,
        width: int = 1280,
        height: int = 900,
        scheme: str = "light",
        touch: bool = False,
        scripts: bool = True,
        still: bool = False,
    ) -> Opened:
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            has_touch=touch,
            java_script_enabled=scripts,
            accept_downloads=True,
            reduced_motion="reduce" if still else "no-preference",
        )
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        contexts.append(context)
        return opened(context, file, scripts=scripts)

    yield open_it
    for context in contexts:
        context.close()
