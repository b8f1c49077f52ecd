"""The drawing sheets on a page."""

from __future__ import annotations

from collections.abc import Sequence

from strainsight.report.sheets.paper import SIZE

LARGEST = 2_000_000
"""[bytes] of all sheets on a page: what goes beyond is in the files alone."""


def sheets_section(sheets: Sequence[bytes]) -> str:
    """HTML of the sheets, folded; "" where there are none."""
    shown, room = [], LARGEST
    for sheet in sheets:
        room -= len(sheet)
        if room < 0:
            break
        # As wide as the page has room: millimetres are those of the file, which is to be printed.
        text = sheet.decode()
        shown.append(f'<figure class="card">{text.replace(SIZE, "", 1)}</figure>')
    if not sheets:
        return ""
    rest = f" {len(sheets) - len(shown)} more are in the files alone." * (len(shown) < len(sheets))
    return (
        f"<details><summary>{len(sheets)} drawing sheet{'s' * (len(sheets) > 1)} for the workshop</summary>"
        f'<p class="note">To print them, at 100 % on A4: the files sheet-….svg beside this page.{rest}</p>'
        f"{''.join(shown)}</details>"
    )
