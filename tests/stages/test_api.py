"""The library computes what the command line writes, and reads it again."""

from __future__ import annotations

import ast
import inspect
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
import pyvista

from strainsight import api
from strainsight.errors import ArtefactError, ConfigError, UserError

from .conftest import ROOT, SHORT

LINES = 12


@pytest.fixture(scope="module")
def run_there(artefacts):
    return api.open_run(artefacts["place"].path.parent)


def cantilever():
    case = api.load(ROOT / "configs" / "cantilever-youngs-modulus.yaml", SHORT)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, training)
    layout = api.place(case, mesh, reduced, training, screened)
    return reduced, training, screened, layout


def test_the_cantilever_takes_few_lines_and_has_the_layout_of_the_command_line(run_there):
    (function,) = ast.parse(inspect.getsource(cantilever)).body
    assert len(function.body) <= LINES
    reduced, training, screened, layout = cantilever()
    there = run_there.placed
    np.testing.assert_array_equal(layout.gauges, there.final.number)
    np.testing.assert_array_equal(layout.listed.position, there.final.position)
    np.testing.assert_array_equal(layout.elimination.removed, there.elimination.removed)
    np.testing.assert_array_equal(layout.elimination.cost, there.elimination.trace)
    assert layout.advice == there.advice
    assert layout.layout.certificate.gap == there.certificate.gap
    np.testing.assert_array_equal(reduced.basis, run_there.reduced.basis)
    np.testing.assert_array_equal(training.reading, run_there.training.reading)
    np.testing.assert_array_equal(screened.noise_std, run_there.screened.noise_std)


def everything(record):
    """Every field of a record, and of those below it."""
    for field in fields(record):
        value = getattr(record, field.name)
        for part in value.values() if isinstance(value, dict) else (value,):
            yield part
            if is_dataclass(part):
                yield from everything(part)


@pytest.mark.parametrize(
    "stage", ["mesh", "modes", "reduced", "training", "screened", "observed", "placed", "validated"]
)
def test_all_that_a_run_has_written_is_read(run_there, stage):
    found = list(everything(getattr(run_there, stage)))
    assert any(isinstance(part, np.ndarray) and part.size for part in found)


def test_grids_go_to_pyvista(run_there):
    assert isinstance(run_there.to_pyvista("import"), pyvista.UnstructuredGrid)
    assert run_there.to_pyvista("import").n_points == len(run_there.mesh.position)
    assert "rank" in run_there.to_pyvista("place").point_data
    with pytest.raises(UserError, match="writes no grid"):
        run_there.to_pyvista("screen")


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(UserError, match="no results of a run"):
        api.open_run(tmp_path)
    with pytest.raises(ConfigError, match="config of kind bench"):
        api.load(ROOT / "configs" / "bench" / "loads.yaml")
    (tmp_path / "import.h5").write_bytes(b"")
    with pytest.raises(ArtefactError):
        _ = api.open_run(tmp_path).placed
