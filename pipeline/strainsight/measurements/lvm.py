"""The header of LabVIEW's measurement files (.lvm), which says how the table below it is written.

Two parts, each up to a line ***End_of_Header***: the file's with Separator (Tab or Comma) and Decimal_Separator, and the
segment's with a cell for every channel, of which Y_Unit_Label is taken. Below it stand the names, the first of them X_Value
and the last one Comment, whose cell most lines leave out. NI, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from strainsight.errors import UserError
from strainsight.measurements.csv_layout import Layout, TextFormat
from strainsight.measurements.records import decoded, plain

SIGN = b"LabVIEW Measurement"
_END = "***End_of_Header***"
_LONGEST = 1000
"""Lines of a header."""


@dataclass(frozen=True)
class Header:
    """form: how the table is written; units: of the columns behind the first, "" where none is stated."""

    form: TextFormat
    units: tuple[str, ...]

    def applied(self, layout: Layout) -> Layout:
        """The layout with the units of the header, and without the column of remarks."""
        remarks = layout.names[-1] == "Comment" and len(layout.names) - 1 not in layout.columns
        count = len(layout.names) - remarks
        stated = (None, *(unit or None for unit in self.units))
        units = [own or (stated[i] if i < len(stated) else None) for i, own in enumerate(layout.units[:count])]
        return replace(layout, names=layout.names[:count], units=tuple(units), remarks=remarks)


def header_of(block: bytes, form: TextFormat, path: str) -> Header:
    """The header that a file begins with; its delimiter and decimal mark are those of the file.

    Raises UserError where it has no end, or says that the times are left out or that every channel has its own.
    """
    lines = [decoded(line).rstrip() for line in block.split(b"\n", _LONGEST)[:_LONGEST]]
    ends = [number for number, line in enumerate(lines, start=1) if line.startswith(_END)]
    if len(ends) < 2:
        raise UserError(
            f"a LabVIEW measurement file without two lines {_END}",
            where=path,
            remedy="export the test data again: it was cut short or altered",
        )
    mark = "," if any(line.lower().startswith("separator,") for line in lines[: ends[0]]) else "\t"
    said = {}
    for number, line in enumerate(lines[: ends[1]], start=1):
        word, _, rest = line.partition(mark)
        said[word] = (number, rest)
    number, columns = said.get("X_Columns", (1, "One"))
    if columns.strip() not in ("One", ""):
        raise UserError(
            f"X_Columns is {plain(columns)}: "
            + ("no times are written" if columns.strip() == "No" else "a time for every channel"),
            where=f"{path}:{number}",
            remedy="write the file with one column of times (X value columns: one column only)",
        )
    decimal = said.get("Decimal_Separator", (0, form.decimal))[1].strip() or "."
    first = form.header_line or next((n for n in range(ends[1], len(lines)) if lines[n].strip()), ends[1]) + 1
    units = tuple(cell.strip() for cell in said.get("Y_Unit_Label", (0, ""))[1].split(mark))
    return Header(replace(form, delimiter=mark, decimal=decimal, header_line=first, comment=""), units)
