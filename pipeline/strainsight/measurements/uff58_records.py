"""The headers of universal files: datasets 58 and 58b (functions at nodal DOF), and 164 (units)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from strainsight.errors import UserError
from strainsight.measurements.records import decoded, plain

DAMAGED = "export the file again: it was cut short or altered"
HEADER = 11
"""Records in front of the values."""
_DIRECTIONS = {1: "X", 2: "Y", 3: "Z", 4: "RX", 5: "RY", 6: "RZ"}
_SI = {8: "m", 9: "N", 12: "m/s2", 13: "N", 15: "Pa"}
"""Specific data type → unit where dataset 164 says the file is in SI."""
NONE = ("", "NONE")


@dataclass(frozen=True)
class Function:
    """One function of the file, without its values.

    number: of the dataset, from 1; line (0 where lines no longer count) and offset [bytes] of its values; kind: function
    type; double, complex_: ordinate; count of values; even: abscissa spacing, then start and increment; order: of the
    bytes, "<" or ">", "" for text.
    """

    number: int
    line: int
    offset: int
    order: str
    id_line: str
    kind: int
    node: int
    direction: int
    double: bool
    complex_: bool
    count: int
    even: bool
    start: float
    increment: float
    abscissa: int
    time_unit: str | None
    unit: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """What it may be asked for by: "12:3", "12:+Z", and its first id line."""
        sign = "-" if self.direction < 0 else "+"
        words = [f"{self.node}:{self.direction}"]
        if abs(self.direction) in _DIRECTIONS:
            words.append(f"{self.node}:{sign}{_DIRECTIONS[abs(self.direction)]}")
        if self.id_line not in NONE:
            words.append(self.id_line)
        return tuple(words)

    @property
    def layout(self) -> tuple[int, ...]:
        """Widths [characters] of the numbers of one value in text: its abscissa where uneven, its ordinates."""
        wide = 20 if self.double else 13
        return (() if self.even else (13,)) + (wide,) * (2 if self.complex_ else 1)

    @property
    def per_line(self) -> int:
        """Values on a line of text: 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
        return 80 // sum(self.layout)

    @property
    def sizes(self) -> tuple[tuple[int, ...], ...]:
        """Bytes of the numbers of one value in binary. The standard keeps the abscissa single; some write it double."""
        ordinate = (8 if self.double else 4,) * (2 if self.complex_ else 1)
        if self.even:
            return (ordinate,)
        return ((4, *ordinate), (8, *ordinate)) if self.double else ((4, *ordinate),)


def function_of(
    number: int, identifier: bytes, records: Sequence[bytes], line: int, offset: int, where: str, *, si: bool
) -> Function:
    """The function that the identifier line and the eleven records behind it describe.

    line: that of the first record, 0 where lines do not count; where: the place of the dataset; si: dataset 164 says so.
    Raises UserError where a record does not have its form.
    """

    def at(record: int) -> str:
        return f"{where.rpartition(':')[0]}:{line + record - 1}" if line else f"{where}, record {record}"

    order = _byte_order(decoded(identifier), where)
    text = [decoded(record.rstrip(b"\r\n")) for record in records]
    dof = _fields(text[5], at(6), "the DOF", (5, 10, 5, 10, -11, 10, 4))
    form = _fields(text[6], at(7), "the form of the data", (10, 10, 10, 13.5, 13.5))
    ordinate, count, spacing = (int(value) for value in form[:3])
    if ordinate not in (2, 4, 5, 6) or spacing not in (0, 1) or not 0 < count < 10**12:
        raise UserError(
            f"ordinates of type {ordinate}, {count} values, spacing {spacing}: no form of data of dataset 58",
            where=at(7),
            remedy=DAMAGED,
        )
    abscissa, time_unit = _axis(text[7], at(8))
    kind, unit = _axis(text[8], at(9))
    _, below = _axis(text[9], at(10))
    if unit is None and si:
        unit = _SI.get(kind)
    elif unit is not None and below is not None:
        unit = f"{unit}/{below}"
    return Function(
        number=number,
        line=line + HEADER if line else 0,
        offset=offset,
        order=order,
        id_line=text[0].strip(),
        kind=int(dof[0]),
        node=int(dof[4]),
        direction=int(dof[5]),
        double=ordinate in (4, 6),
        complex_=ordinate in (5, 6),
        count=count,
        even=spacing == 1,
        start=form[3],
        increment=form[4],
        abscissa=abscissa,
        time_unit=time_unit,
        unit=unit,
    )


def is_si(record: bytes) -> bool:
    """Does the first record of dataset 164 say SI, metre and newton (code 1)?"""
    return record[:10].strip() == b"1"


def _byte_order(identifier: str, where: str) -> str:
    """ "" for text; "<" or ">" for 58b, whose line has the form (I6,1A1,I6,I6,I12,I12,…)."""
    if identifier[6:7].lower() != "b":
        return ""
    order, floats, lines = (int(value) for value in _fields(identifier[7:], where, "the identifier", (6, 6, 12)))
    if order not in (1, 2) or floats != 2 or lines != HEADER:
        said = {1: "numbers of DEC VMS", 3: "numbers of IBM 370"}.get(
            floats, f"byte order {order}, numbers {floats}, {lines} lines"
        )
        raise UserError(
            f"{said} in dataset 58b", where=where, remedy="export IEEE 754 numbers behind 11 lines, or the file as text"
        )
    return "<" if order == 1 else ">"


def _fields(text: str, where: str, what: str, widths: tuple[float, ...]) -> list[float]:
    """Numbers in columns: integers by whole widths, reals by 13.5, blank ones zero; a negative width passes over text."""
    found, at = [], 0
    for width in widths:
        piece = text[at : at + abs(int(width))].strip()
        at += abs(int(width))
        if width < 0:
            continue
        value = 0.0 if not piece else number_of(piece)
        if value is None or not math.isfinite(value) or (width == int(width) and value != int(value)):
            raise UserError(
                f"{plain(piece)} is no number of {what}: {plain(text, 80)}",
                where=where,
                remedy="the record has fixed columns: export the file again, by a writer that keeps to them",
            )
        found.append(value)
    return found


def _axis(text: str, where: str) -> tuple[int, str | None]:
    """Specific data type and unit of a record (I10,3I5,2(1X,20A1))."""
    (kind,) = _fields(text, where, "the axis", (10,))
    unit = text[46:].strip()
    return int(kind), None if unit.upper() in NONE else unit


def number_of(piece: str | bytes) -> float | None:
    """A number as Fortran prints it, 1.5D-3 and 1.5-103 too; None where it is none."""
    text = piece.decode("latin-1") if isinstance(piece, bytes) else piece
    if "_" in text:
        return None
    text = text.strip().upper().replace("D", "E")
    try:
        return float(text)
    except ValueError:
        pass
    # Fortran drops the letter where the exponent has three digits: 1.5-105
    at = max(text.rfind("+"), text.rfind("-"))
    try:
        return float(f"{text[:at]}E{text[at:]}") if at > 0 else None
    except ValueError:
        return None


def known_names(functions: Sequence[Function]) -> Mapping[str, list[Function]]:
    """Name → the functions it may mean."""
    found: dict[str, list[Function]] = {}
    for function in functions:
        for name in dict.fromkeys(function.names):
            found.setdefault(name, []).append(function)
    return found
