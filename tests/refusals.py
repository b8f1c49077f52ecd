"""Errors of the product as tests expect them: what they say, where, of which key, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from strainsight.errors import StrainsightError


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
