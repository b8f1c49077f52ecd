"""A page opened from its file, with all it says and asks for written down."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import BrowserContext, Page

OWN = ("data:", "blob:")
"""Addresses that lie within the page."""


@dataclass(frozen=True)
class Opened:
    """page; file it came from; requested: addresses it asked for, its own file among them; said: what stood in the console,
    as (type, text); wrong: errors of its scripts and dialogs that nothing on the page should open."""

    page: Page
    file: Path
    requested: list[str]
    said: list[tuple[str, str]]
    wrong: list[str]


def opened(context: BrowserContext, file: Path, *, scripts: bool = True) -> Opened:
    """Open the file as a person would from a folder, and wait until it is drawn; scripts: whether the context runs any."""
    page = context.new_page()
    found = Opened(page, file, [], [], [])
    page.on("request", lambda request: found.requested.append(request.url))
    page.on("websocket", lambda socket: found.requested.append(socket.url))
    page.on("console", lambda message: found.said.append((message.type, message.text)))
    page.on("pageerror", lambda error: found.wrong.append(str(error)))
    page.on("popup", lambda other: found.wrong.append(f"opened {other.url}"))

    def closed(dialog) -> None:
        found.wrong.append(f"{dialog.type}: {dialog.message}")
        dialog.dismiss()

    page.on("dialog", closed)
    page.goto(file.as_uri(), wait_until="load")
    if scripts and page.locator("#space-view").count():
        page.wait_for_selector('#space-view[data-ready="true"]', state="attached", timeout=30_000)
    return found


def asked_outside(found: Opened) -> list[str]:
    """Addresses beyond the page's own file that it asked for."""
    own = found.file.as_uri()
    return [url for url in found.requested if url.split("#")[0] != own and not url.startswith(OWN)]
