"""meshio in the process of the tests: to start another for each of some hundred files takes a minute."""

from __future__ import annotations

import pytest

from strainsight.decks.other import mesh
from strainsight.decks.other.load import load


@pytest.fixture(autouse=True)
def here(request, monkeypatch):
    if request.path.name != "test_sandbox.py":
        monkeypatch.setattr(mesh, "load_sandboxed", load)
