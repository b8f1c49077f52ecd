"""Dates and times of the day in the time column of a text table → seconds since the first of them."""

from __future__ import annotations

import re
from datetime import date

_INSTANT = re.compile(
    r"(?:(?P<date>[\w./-]+(?: [A-Za-z]{3,9}\.? \d{2,4})?)(?:T|\s+|(?<=\d)_))?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,12})|:(?P<milli>\d{3}))?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
)
_YEAR_FIRST = re.compile(r"(\d{4})([-/.])(\d{1,2})\2(\d{1,2})")
SECOND, DAY = 10**9, 86400 * 10**9
"""[ns]."""


class ClockTimes:
    """Seconds since the first instant of a column, to the nanosecond.

    2024-05-03T10:00:00.01+02:00, 2024/5/3 10:00:00,01, 03.05.2024 10:00:00 and 10:00:00.01 PM are understood. Of dates whose day
    may be the month only the change counts: together with a clock that passes midnight it is the next day.
    """

    def __init__(self) -> None:
        self._first: int | None = None
        self._date, self._of_day, self._day = "", 0, 0

    @property
    def started(self) -> bool:
        """Whether an instant has been read."""
        return self._first is not None

    def seconds(self, cell: str) -> float | None:
        """Of one cell; None where it is no instant, or its date does not follow that of the cell before."""
        match = _INSTANT.fullmatch(cell)
        if match is None or (of_day := _of_day(match)) is None:
            return None
        text = match["date"] or ""
        year_first = _YEAR_FIRST.fullmatch(text)
        midnight = self.started and self._of_day - of_day > DAY // 2
        if year_first:
            try:
                day = date(*(int(year_first[i]) for i in (1, 3, 4))).toordinal()
            except ValueError:
                return None
        else:
            if self.started and text and (text != self._date) != midnight:
                return None
            day = self._day + midnight
        zone = match["zone"] or "Z"
        east = 0 if zone == "Z" else int(zone[0] + "1") * (int(zone[1:3]) * 60 + int(zone[-2:]))
        instant = day * DAY + of_day - east * 60 * SECOND
        self._date, self._of_day, self._day = text, of_day, day
        if self._first is None:
            self._first = instant
        return (instant - self._first) / SECOND


def _of_day(match: re.Match[str]) -> int | None:
    """[ns] since midnight; None where no clock shows that."""
    hour, minute, second = (int(match[name]) for name in ("hour", "minute", "second"))
    if match["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (match["half"][0] in "Pp")
    if hour > 23 or minute > 59 or second > 60:
        return None
    fraction = (match["fraction"] or match["milli"] or "").ljust(9, "0")[:9]
    return ((hour * 60 + minute) * 60 + second) * SECOND + int(fraction)
