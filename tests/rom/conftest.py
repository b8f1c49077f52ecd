"""The bar of three interfaces, held and free."""

from __future__ import annotations

import pytest

from strainsight.fem.model import build_model

from .bars import bar


@pytest.fixture(scope="package")
def clamped():
    """Held at ROOT; TIP and SIDE are interfaces."""
    return build_model(bar(side=True, clamped=True))


@pytest.fixture(scope="package")
def free():
    return build_model(bar(side=True), supported=False)
