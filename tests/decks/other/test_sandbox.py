"""meshio in a child process gives what it gives here, and costs the file where it crashes, hangs or wants all memory."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

from strainsight import child_reader
from strainsight.decks.other import load as loading
from strainsight.decks.other.load import load
from strainsight.decks.other.mesh import read_meshio
from strainsight.errors import DeckError

from ...records.test_record import same

POINTS = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
MESH = meshio.Mesh(
    POINTS,
    [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]]), ("triangle", [[0, 1, 2]])],
    point_data={"node_id": np.arange(1, 6), "foot": np.array([1, 1, 1, 0, 0]), "T": np.arange(15.0).reshape(5, 3)},
    cell_data={"region": [np.array([1, 2]), np.array([0])]},
)


def test_sandbox_gives_same_result(tmp_path):
    MESH.write(tmp_path / "part.xdmf")
    apart, here = (read_meshio(tmp_path / "part.xdmf", sandboxed=choice) for choice in (True, False))
    assert same(apart, here)


@pytest.mark.skipif(sys.platform != "linux", reason="only there a process can be kept from its memory")
def test_oversized_declaration_is_refused(tmp_path):
    """By the count of attributes of a point."""
    (tmp_path / "part.ele").write_text("1 4 0\n1 1 1 1 1\n")
    (tmp_path / "part.node").write_text("1 3 1000000000000 0\n1 0 0 0\n")
    with pytest.raises(DeckError) as caught:
        read_meshio(tmp_path / "part.node")
    assert caught.value.where == str(tmp_path / "part.node")


@pytest.mark.parametrize("name", ["part.vtu", "part.xdmf"])
def test_xml_entities_are_not_expanded(tmp_path, name):
    (tmp_path / "secret").write_text("of nobody's business")
    many = "".join(f"<!ENTITY e{i} '{f'&e{i - 1};' * 10}'>" for i in range(1, 10))
    for text in (f"<!ENTITY e0 'x'>{many}", f"<!ENTITY e9 SYSTEM '{(tmp_path / 'secret').as_uri()}'>"):
        (tmp_path / name).write_text(f"<?xml version='1.0'?><!DOCTYPE VTKFile [{text}]><VTKFile>&e9;</VTKFile>")
        with pytest.raises(DeckError, match="cannot be read as") as caught:
            load(tmp_path / name)
        assert "nobody" not in str(caught.value)


@pytest.mark.parametrize("does", ["import os; os.abort()", "import time; time.sleep(60)"])
def test_library_crash_is_reported(tmp_path, monkeypatch, does):
    MESH.write(tmp_path / "part.vtu")
    monkeypatch.setattr(loading, "COMMAND", [sys.executable, "-c", does])
    monkeypatch.setattr(child_reader, "START_LIMIT", 0.5)
    with pytest.raises(DeckError, match="reading the file crashed or took too long"):
        read_meshio(tmp_path / "part.vtu")


def test_working_folder_is_not_imported(tmp_path, monkeypatch):
    MESH.write(tmp_path / "part.vtu")
    (tmp_path / "meshio.py").write_text(f"open({str(tmp_path / 'taken')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert len(read_meshio(Path("part.vtu")).node_ids) == 5
    assert "taken" not in os.listdir(tmp_path)
