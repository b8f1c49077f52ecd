"""The library computes what the command line writes and reads it again; gauges whose rows come from a file."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
from dataclasses import fields, is_dataclass
from typing import get_args, get_type_hints

import numpy as np
import pytest
import pyvista
from scipy import sparse
from typer.testing import CliRunner
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight import api
from strainsight.errors import ArtefactError, ConfigError, DeckError, InfeasibleError, UserError
from strainsight.experiment.structure.bonded_gauges import read_given
from strainsight.sensors.bonded import without
from strainsight.sensors.zones import Box, NearEdges
from strainsight_cli.main import app

from ..models import ended, project
from ..robustness.small import BENCH
from .conftest import COARSE, LOADS, ROOT
from .test_bench_sensors import RIG

LINES = 12


@pytest.fixture(scope="module")
def run_there(artefacts):
    return api.open_run(artefacts["place"].path.parent)


def cantilever():
    case = api.load(ROOT / "configs" / "cantilever-youngs-modulus.yaml", COARSE)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    layout = api.place(case, mesh, reduced, training, screened)
    return reduced, training, screened, layout


@pytest.mark.slow
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
    np.testing.assert_array_equal(training.reading(), run_there.training.reading())
    np.testing.assert_array_equal(screened.noise_std, run_there.screened.noise_std)


def same(record, there):
    """Every array of a record is that of another, to the bit."""
    ours, theirs = (list(everything(own)) for own in (record, there))
    assert len(ours) == len(theirs) > 5
    for own, other in zip(ours, theirs, strict=True):
        if isinstance(own, np.ndarray):
            np.testing.assert_array_equal(own, other)


@pytest.mark.slow
def test_a_validation_has_the_arrays_of_the_command_line(run_there):
    case, mesh, reduced, training, screened = before_placing(COARSE)
    found = api.validate(case, mesh, reduced, training, screened, run_there.placed.final.number)
    same(found.validated, run_there.validated)
    summary = run_there.artefact("validate").summary
    assert found.accuracy["E"].error == summary["error.E"]
    assert found.accuracy["E"].smoothed_std == summary["smoothed_std.E"]
    same(api.observe(case, reduced, training, screened), run_there.observed)
    own = api.expect(case, mesh, reduced, training, screened, run_there.placed.final.number)
    # the placement has summed them up in another order
    np.testing.assert_allclose(own.without["E"], run_there.placed.without["E"], rtol=1e-12)


@pytest.mark.slow
def test_an_estimate_has_the_arrays_of_the_command_line(results, tmp_path):
    folder = next(path for path in results.iterdir() if (path / "measured.csv").exists())
    channels = [{"channel": f"G{i}", "gauge": f"G{i}", "unit": "m/m"} for i in range(1, 5)]
    text = (ROOT / "configs" / "cantilever-youngs-modulus.yaml").read_text().replace("../meshes", str(ROOT / "meshes"))
    stated = {
        "file": str(folder / "measured.csv"),
        "as_placed": True,
        "time": {"channel": "time"},
        "channels": channels,
        "inputs": {"tip": {"channel": "tip", "unit": "N"}},
        "virtual": [{"position": [1.0, 0.02, 0.095], "direction": [1, 0, 0]}],
        "field": {"every": 0.05},
    }
    config = tmp_path / "test.yaml"
    config.write_text(f"{text}\nestimate: {json.dumps(stated)}\n")
    shutil.copytree(results, tmp_path / "results")
    options = ["--no-page", *(f"--set={words}" for words in COARSE)]
    done = CliRunner().invoke(app, ["estimate", str(config), "--results", str(tmp_path / "results"), *options])
    assert done.exit_code == 0, done.output
    run = api.open_run(tmp_path / "results" / "cantilever-youngs-modulus")
    case, mesh, reduced, training, screened = before_placing(COARSE, config)
    found = api.estimate(case, mesh, reduced, training, screened, run.placed.final.number)
    same(found.estimated, run.estimated)
    ours, theirs = api.to_pyvista(found.surface, 2), run.to_pyvista("estimate", 2)
    np.testing.assert_array_equal(ours.cell_data["strain"], theirs.cell_data["strain"])
    assert ours.n_cells == theirs.n_cells > 100
    reader = vtkHDFReader()
    reader.SetFileName(str(run.artefact("estimate").path))
    reader.UpdateInformation()
    reader.SetStep(2)
    reader.Update()
    by_vtk = pyvista.wrap(reader.GetOutput())
    np.testing.assert_array_equal(theirs.cell_data["strain"], by_vtk.cell_data["strain"])
    np.testing.assert_array_equal(theirs.point_data["displacement"], by_vtk.point_data["displacement"])
    np.testing.assert_array_equal(theirs.cell_centers().points, by_vtk.cell_centers().points)


def before_placing(overrides, config=ROOT / "configs" / "cantilever-youngs-modulus.yaml"):
    case = api.load(config, overrides)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    return case, mesh, reduced, training, api.screen(case, mesh, reduced, training)


def everything(record):
    """Every field of a record, and of those below it."""
    for field in fields(record):
        value = getattr(record, field.name)
        for part in (value[key] for key in sorted(value)) if isinstance(value, dict) else (value,):
            yield part
            if is_dataclass(part):
                yield from everything(part)


FUNCTIONS = {name: getattr(api, name) for name in api.__all__ if inspect.isfunction(getattr(api, name))}
METHODS = ("meshes", "reduce", "place", "simulate", "estimate")
FUNCTIONS |= {name: getattr(api.BenchCase, name) for name in METHODS}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_a_function_returns_has_a_public_class_that_names_its_fields(name):
    """In the docstring of the class, or with the field, as artefacts are described."""
    public = {getattr(api, own): own for own in api.__all__ if inspect.isclass(getattr(api, own))}
    scope = {own: getattr(api, own) for own in api.__all__}
    returned = get_type_hints(FUNCTIONS[name], localns=scope | {"pyvista": pyvista})["return"]
    for own in get_args(returned) or (returned,):
        if own.__module__.startswith("strainsight"):  # and not str, pyvista's own, …
            assert own in public, f"{name} returns {own.__name__}"
            assert public[own] in (ROOT / "docs" / "python.md").read_text()
            text = " ".join(base.__doc__ or "" for base in own.__mro__)
            for field in fields(own) if is_dataclass(own) else ():
                assert field.metadata or re.search(rf"\b{field.name}\b", text), (own, field.name)


def test_all_that_a_bench_has_written_is_read(bench):
    run = api.open_bench(bench["simulate"].path.parent)
    np.testing.assert_array_equal(run.simulated.sensors["relative"], bench["simulate"]["/sensors/relative"])
    np.testing.assert_array_equal(run.reduced["hub"].frequency, bench["reduce"]["/bodies/hub/frequency"])
    np.testing.assert_array_equal(run.meshes["hub"].position, bench["import"]["/bodies/hub/nodes/position"])
    assert len(list(everything(run.bearings))) > 2
    with pytest.raises(UserError, match="contains no mesh"):
        run.to_pyvista("simulate")
    with pytest.raises(ArtefactError):
        _ = run.surface


def test_a_bench_has_the_arrays_of_the_command_line():
    end = ended("estimate", BENCH)
    run, case = api.open_bench(end.folder), api.bench(project(BENCH))
    meshes = case.meshes()
    bodies = case.reduce(meshes)
    same(bodies["beam"], run.reduced["beam"])
    placed = case.place(meshes, bodies)
    same(placed, run.placed)
    same(case.simulate(meshes, bodies, placed), run.simulated)
    same(case.estimate(meshes, bodies, placed), run.estimated)


def test_what_a_config_of_a_bench_has_not_is_refused():
    case = api.bench(project(RIG))
    with pytest.raises(ConfigError, match="no section 'place'"):
        case.place({}, {})
    with pytest.raises(ConfigError, match="config has the kind placement"):
        api.bench(ROOT / "configs" / "cantilever-youngs-modulus.yaml")


def test_grids_go_to_pyvista(run_there):
    assert isinstance(run_there.to_pyvista("import"), pyvista.UnstructuredGrid)
    assert run_there.to_pyvista("import").volume == pytest.approx(api.to_pyvista(run_there.mesh).volume)
    assert run_there.to_pyvista("import").n_points == len(run_there.mesh.position)
    assert "rank" in run_there.to_pyvista("place").point_data
    with pytest.raises(UserError, match="contains no mesh"):
        run_there.to_pyvista("screen")


def test_what_is_not_there_is_reported(tmp_path):
    with pytest.raises(UserError, match="no results of a run"):
        api.open_run(tmp_path)
    with pytest.raises(ConfigError, match="the config has the kind bench"):
        api.load(LOADS)
    (tmp_path / "import.h5").write_bytes(b"")
    with pytest.raises(ArtefactError):
        _ = api.open_run(tmp_path).placed


HEAD = "gauge,x,y,z,dx,dy,dz\n"
TABLE = HEAD + "7,100,0,25,2,0,0\n3,200,0,-25,,,\n5,300.5,0,25,0,3,4\n"
COMPONENTS = np.array([0, 2, 4])


@pytest.fixture
def files(tmp_path):
    """Rows in 1/mm and 1/rad on two translations and a rotation; the table in mm."""
    sparse.save_npz(tmp_path / "rows.npz", sparse.csr_array([[1e-3, 0, 0.5], [0, 2e-3, 0], [0, 0, -0.25]]))
    (tmp_path / "gauges.csv").write_text(TABLE)
    return tmp_path / "rows.npz", tmp_path / "gauges.csv"


def test_rows_and_positions_are_converted_and_directions_made_unit(files):
    given = read_given(*files, COMPONENTS, 1e-3)
    assert np.allclose(given.rows.toarray(), [[1.0, 0, 0.5], [0, 2.0, 0], [0, 0, -0.25]])
    assert given.pool.element.tolist() == [7, 3, 5]
    assert np.allclose(given.pool.position, [[0.1, 0, 0.025], [0.2, 0, -0.025], [0.3005, 0, 0.025]])
    assert np.allclose(given.pool.direction, [[1, 0, 0], [0, 0, 0], [0, 0.6, 0.8]])
    assert not given.pool.facet.any()
    assert np.all(given.pool.nodes == -1)


def test_zones_take_rows_and_table_equally(files):
    given = read_given(*files, COMPONENTS, 1e-3)
    left = without(given, None, None, [Box((0.15, -1, -1), (0.25, 1, 1)), NearEdges(1.0)])
    assert left.pool.element.tolist() == [7, 5]
    assert np.array_equal(left.rows.toarray(), given.rows.toarray()[[0, 2]])
    with pytest.raises(InfeasibleError, match=r"excluded zones \(imported gauges: 3\)"):
        without(given, None, None, [Box((-1, -1, -1), (1, 1, 1))])


@pytest.mark.parametrize(
    ("table", "said", "line"),
    [
        (HEAD + "1,2,3\n", "is 3, not 7", 2),
        (HEAD + "1,0,0,0,,,\nG2,0,0,0,,,\n", "contains a value that is not a number", 3),
        (HEAD + "1,0,0,0,,,\n2,0,0,0,,,\n1,0,0,0,,,\n", "gauge number 1 is used twice", 4),
        (HEAD, "no gauge", None),
    ],
)
def test_a_table_that_is_none_is_refused_at_its_line(files, table, said, line):
    rows, path = files
    path.write_text(table)
    with pytest.raises(DeckError, match=said) as caught:
        read_given(rows, path, COMPONENTS, 1.0)
    assert caught.value.where == (f"{path}:{line}" if line else str(path))


def test_rows_that_do_not_fit_the_table_or_the_matrices_are_refused(files):
    rows, table = files
    with pytest.raises(DeckError, match="3 columns, but the stiffness matrix has 4 rows"):
        read_given(rows, table, np.arange(4), 1.0)
    table.write_text(TABLE + "9,0,0,0,,,\n")
    with pytest.raises(DeckError, match=r"3 rows, but gauges\.csv has 4 gauges"):
        read_given(rows, table, COMPONENTS, 1.0)
