"""How long report pages take to open: `python -m benchmarks.page results/NAME/report.html [more pages]`.

Prints of every page its size, the times from the start of navigation to the first paint, to the end of loading and to the 3D
view's first picture: medians of five fresh openings in Debian's chromium, headless, with WebGL drawn in software on the
processor, which a graphics card does faster. Machines differ and are shared: the empty page in the first line is what the
browser takes by itself.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

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
OPENINGS = 5
EMPTY = '<!DOCTYPE html><html lang="en"><title>empty</title><p>Nothing.</p></html>'
# Notes when the 3D view says that it is drawn, before any script of the page runs.
NOTE = """new MutationObserver((changes, observer) => {
  if (document.querySelector('#space-view')?.dataset.ready !== 'true') return;
  window.spaceReady = performance.now();
  observer.disconnect();
}).observe(document, {subtree: true, childList: true, attributes: true, attributeFilter: ['data-ready']});"""
# [first paint, end of loading, 3D ready or null] in ms since navigation began, once all of them are known.
TIMES = """() => new Promise(done => {
  const read = () => {
    const paint = performance.getEntriesByName('first-contentful-paint')[0]?.startTime;
    const load = performance.getEntriesByType('navigation')[0].loadEventEnd;
    const space = document.querySelector('#space-view') ? window.spaceReady : null;
    if (!paint || !load || space === undefined) return requestAnimationFrame(read);
    done([paint, load, space]);
  };
  read();
})"""


def opening(browser: Browser, file: Path) -> list[float]:
    """[first paint, end of loading, 3D ready (nan without it)] in ms, of one opening in a fresh context."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    context.add_init_script(NOTE)
    page = context.new_page()
    page.goto(file.resolve().as_uri(), wait_until="commit")
    found = page.evaluate(TIMES)
    context.close()
    return [float("nan") if value is None else float(value) for value in found]


def medians(rows: Iterable[list[float]]) -> list[float]:
    return [statistics.median(column) for column in zip(*rows, strict=True)]


def main(files: list[Path]) -> None:
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None or not files:
        sys.exit(__doc__ if path else "no chromium on this machine: apt-get install chromium")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        empty = Path(folder) / "empty.html"
        empty.write_text(EMPTY, encoding="utf-8")
        print(f"{'KiB':>7} {'paint':>8} {'loaded':>8} {'3D ready':>9}  page")
        for file in (empty, *files):
            paint, load, ready = medians(opening(browser, file) for _ in range(OPENINGS))
            shown = f"{ready:6.0f} ms" if ready == ready else "–"
            size = file.stat().st_size / 1024
            print(f"{size:7.0f} {paint:5.0f} ms {load:5.0f} ms {shown:>9}  {file}", flush=True)
        browser.close()


if __name__ == "__main__":
    main([Path(word) for word in sys.argv[1:]])
