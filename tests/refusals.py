"""Errors of the product as tests expect them: what they say, where, of which key, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest

from strainsight.errors import DeckError, StrainsightError


@contextmanager
def expect_refusal(
    error: type[StrainsightError], match: str, where: str | None = None, remedy: str | None = None, key: str | None = None
) -> Iterator[pytest.ExceptionInfo]:
    """The block raises an error whose message matches, whose place ends as stated, with this key and this in its remedy.

    remedy: "" for any; None: not looked at, as of the others.
    """
    with pytest.raises(error, match=match) as caught:
        yield caught
    assert where is None or caught.value.where.endswith(where)
    assert remedy is None or (caught.value.remedy and remedy in caught.value.remedy)
    assert key is None or caught.value.key == key


def refusal_table(build: Callable[..., str], rows: Sequence[tuple], placed: bool = True, before: int = 0) -> Callable[..., None]:
    """A test of every row: the deck build(*arguments) is refused with a remedy at its place.

    rows: (*arguments, message, place), the last a line after `before` others or the end of the place; (*arguments, message)
    where they are not placed, and the place is any line.
    """

    @pytest.mark.parametrize("row", rows, ids=[row[-2] if placed else row[-1] for row in rows])
    def test(read, row):
        *arguments, message, place = row if placed else (*row, "")
        where = f":{before + place}" if isinstance(place, int) else place
        with expect_refusal(DeckError, message, where=where, remedy="") as caught:
            read(build(*arguments))
        assert placed or caught.value.where.rpartition(":")[2].isdigit()

    return test
