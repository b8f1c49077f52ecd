"""Views, the strain of the surface and figures as files: they hold what the artefacts hold."""

from __future__ import annotations

import csv
import io
import shutil
from dataclasses import replace
from html import escape
from itertools import product

import numpy as np
import pytest
import pyvista as pv
import vtkmodules.vtkCommonCore

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import UserError
from strainsight.experiment.structure.surface import surface_strains
from strainsight.pages.view.viewing import DOTS, FACETS
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.figures import figures_of
from strainsight.stages.placement import REPORT
from strainsight.stages.view.views import offers_of, view_of

from .conftest import COARSE, finished, job_of
from .test_bench_place import written

NAMES = ("import", "rom", "train", "screen", "place", "validate", "report")


@pytest.fixture(scope="module")
def job(config, results):
    return job_of(config, results, *COARSE)


@pytest.fixture(scope="module")
def placement(job):
    return lambda what=None, **asked: view_of(job.model, NAMES, job.folder, "own.yaml", what, **asked)[0]


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The loaded beam of a bench with placed gauges and its field: its artefacts, and a function that views it."""
    folder = tmp_path_factory.mktemp("view")
    job = job_of(written(folder), folder / "results")
    stages = [stage for stage in bench_stages(job.config) if stage.name != "report"]
    names = [stage.name for stage in stages]
    done = {name: artefact for name, (_, _, artefact) in finished(job, stages).items()}
    return done, lambda what=None, **asked: view_of(job.model, names, job.folder, "own.yaml", what, **asked)[0]


def test_a_layout_has_the_gauges_of_the_artefact(placement, artefacts):
    view = placement("layout")
    np.testing.assert_array_equal(
        [gauge.position for gauge in view.layout.gauges], artefacts["place"]["/selected/final/position"]
    )
    assert [gauge.label for gauge in view.layout.gauges] == ["G1", "G2", "G3", "G4"]
    assert len(view.layout.pool) == len(artefacts["place"]["/pool/candidate"])


def test_modes_have_the_frequencies_and_shapes_of_the_artefact(placement, artefacts):
    view = placement("modes")
    frequency = artefacts["rom"]["/frequency"]
    assert view.panels[0].title == f"mode 1, {frequency[0]:.4g} Hz"
    assert len(view.panels) == min(6, len(frequency))
    basis = artefacts["rom"]["/basis"][:, 0].reshape(-1, 3)
    np.testing.assert_allclose(view.panels[0].values, np.linalg.norm(basis, axis=1), rtol=1e-6, atol=1e-12)
    assert view.unit == "kg^-1/2"


def test_candidates_and_the_field_of_a_validation_are_strains_at_their_places(placement, artefacts):
    view = placement("candidates")
    rms = artefacts["train"]["/rms"]
    assert view.panels[0].values.max() == pytest.approx(1e6 * rms.max())
    assert (view.on, view.unit, len(view.dots)) == (DOTS, "µm/m", len(rms))
    strongest = artefacts["train"]["/gauges/position"][np.argmax(rms)]
    assert np.linalg.norm(view.dots[-1] - strongest) < 1e-9 or np.isclose(np.sort(rms)[-1], np.sort(rms)[-2])
    field = placement("field")
    strain = artefacts["validate"]["/field/strain"]
    np.testing.assert_allclose(np.sort(field.panels[0].values), 1e6 * np.sort(strain[np.isfinite(strain)]))
    with pytest.raises(UserError, match="not depend on time"):
        placement("field", at=0.1)


@pytest.mark.slow
def test_the_field_of_a_bench_is_shown_at_its_worst_or_at_the_instant_asked_for(beam):
    done, view = beam
    field = done["field"]
    assert not len(view().panels[0].values)  # the layout
    shown = view("field")
    assert (shown.on, shown.unit) == (FACETS, "MPa")
    assert len(shown.panels[0].values) == len(shown.layout.faces) == field.summary["facets"]
    assert shown.panels[0].values.max() == pytest.approx(field.summary["von_mises"] / 1e6, rel=1e-6)
    stress = field["/VTKHDF/CellData/von_mises"].reshape(3, -1)
    np.testing.assert_allclose(view("field", at=0.019).panels[0].values, stress[1] / 1e6, rtol=1e-6)
    assert "t = 0.02 s" in view("field", at=0.019).panels[0].title
    assert view(at=0.019).quantity == "von Mises stress"  # an instant is one of the field
    # the shift is the displacement of that instant times the factor that the title states
    factor = float(shown.panels[0].title.rpartition("× ")[2])
    assert factor > 1
    step = int(np.argmax(stress.max(axis=1)))
    moved = field["/VTKHDF/PointData/displacement"].reshape(3, -1, 3)[step]
    np.testing.assert_allclose(shown.panels[0].shift, factor * moved, rtol=1e-5, atol=1e-12)
    with pytest.raises(UserError, match=r"time range of the field, 0 to 0\.05 s"):
        view("field", at=0.2)


def test_gauges_of_a_bench_are_those_of_its_sensors_on_the_surface(beam):
    done, view = beam
    gauges = view("layout").layout.gauges
    assert [gauge.label for gauge in gauges] == [f"{name} {i}" for name in ("gauges", "others") for i in (1, 2, 3)]
    np.testing.assert_array_equal([gauge.position for gauge in gauges[:3]], done["place"]["/layouts/place/position"])
    for gauge in gauges:
        # outward, across what is measured
        assert gauge.normal @ (gauge.position - [1.0, 0, 0]) > 0
        assert abs(gauge.normal @ gauge.direction) < 1e-6


def test_what_is_not_there_is_reported_with_what_to_run(tmp_path, job):
    with pytest.raises(UserError, match="no results to show yet") as caught:
        view_of(job.model, NAMES, tmp_path, "own.yaml")
    assert "strainsight import own.yaml" in str(caught.value)
    with pytest.raises(UserError, match=r"import\.h5") as caught:
        view_of(job.model, NAMES, tmp_path, "own.yaml", "modes")
    assert "strainsight rom own.yaml" in str(caught.value)


def test_what_a_config_does_not_have_is_refused_with_the_section_to_add(beam):
    _, view = beam
    with pytest.raises(UserError, match="--body beem: unknown flexible body") as caught:
        view(body="beem")
    assert "did you mean beam" in str(caught.value)
    bench = BenchConfig.model_construct(sensors={}, place=None, field=None, bodies={})
    offers = offers_of(bench, ("import", "reduce", "simulate", "report"), "beam")
    assert set(offers.stages) == {"mesh", "modes"}
    assert "section `field`" in offers.absent["field"]


@pytest.fixture(scope="module")
def strain(placement):
    return placement("strain")


def largest_by_vtk(grid, middle, displacement):
    """Principal strain of largest size (µm/m) at the middle of a face of a hexahedron, by VTK's derivatives of its element."""
    cell = grid.GetCell(grid.find_closest_cell(middle))
    u = displacement[[cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())]].ravel().tolist()
    for axis, side in product(range(3), (0.0, 1.0)):
        at = [0.5, 0.5, 0.5]
        at[axis] = side
        place, weights, slopes = [0.0] * 3, [0.0] * cell.GetNumberOfPoints(), [0.0] * 9
        cell.EvaluateLocation(vtkmodules.vtkCommonCore.reference(0), at, place, weights)
        if np.linalg.norm(np.subtract(place, middle)) < 1e-9:
            cell.Derivatives(0, at, u, 3, slopes)
            gradient = np.array(slopes).reshape(3, 3)
            value = np.linalg.eigvalsh(0.5 * (gradient + gradient.T))
            return 1e6 * value[np.argmax(np.abs(value))]
    raise AssertionError(f"no face of this element has its middle at {middle}")


def facets_of(values):
    return [int(np.argmax(values)), int(np.argmin(values)), *np.random.default_rng(3).integers(len(values), size=4)]


def test_a_load_alone_strains_as_a_beam_does(strain):
    """ε = −F (L − x) z/(E I) on the upper and lower face, away from the clamp and the tip."""
    alone, _ = strain.panels
    assert alone.title == "static strain under load tip alone, 1\u00a0kN"
    assert (strain.on, strain.unit, strain.quantity) == (FACETS, "µm/m", "principal strain of largest magnitude")
    corner = strain.layout.points[strain.layout.faces[:, :4]]
    x, z = corner.mean(axis=1)[:, 0], corner.mean(axis=1)[:, 2]
    inner = (np.abs(np.abs(z) - 0.095) < 1e-9) & (x > 0.4) & (x < 1.6)
    assert inner.sum() == 48
    bent = -1e6 * 1000.0 * (2.0 - x) * z / (1.89e11 * 0.25 * 0.19**3 / 12)
    np.testing.assert_allclose(alone.values[inner], bent[inner], rtol=0.01)


def test_a_training_run_is_shown_at_its_largest_strain_energy(strain, artefacts):
    run = strain.panels[-1]
    q, K = artefacts["train"]["/coordinate"], read(Reduced, artefacts["rom"]).model
    K = K.stiffness.at(K.reference)
    k = max(range(len(q)), key=lambda i: q[i] @ K @ q[i])
    assert run.title == f"training simulation (stage train), t = {artefacts['train']['/time'][k]:.4g} s"
    grid = pv.read(artefacts["import"].path.with_suffix(".vtkhdf"))
    u = (artefacts["rom"]["/basis"] @ q[k]).reshape(-1, 3)
    for i in facets_of(run.values):
        middle = strain.layout.points[strain.layout.faces[i, :4]].mean(axis=0)
        found = largest_by_vtk(grid, middle, u)
        assert run.values[i] == pytest.approx(found, rel=1e-6)


def test_before_anything_is_placed_the_strain_is_shown_without_gauges(job, tmp_path):
    for stage in ("import", "rom", "train"):
        shutil.copy(job.folder / f"{stage}.h5", tmp_path)
    view, read_from = view_of(job.model, NAMES, tmp_path, "own.yaml", "strain")
    assert read_from == ("import", "rom", "train")
    assert view.layout.gauges == ()


def test_what_floats_has_no_strain_at_rest_and_no_solid_none_at_all(artefacts, job):
    reduced, training = read(Reduced, artefacts["rom"]), read(Training, artefacts["train"])
    mesh, model = mesh_from(artefacts["import"]), job.model
    K = reduced.model.stiffness
    loose = replace(K, constant=0 * K.constant, terms={name: 0 * term for name, term in K.terms.items()})
    floating = replace(reduced, model=replace(reduced.model, stiffness=loose))
    assert [own.load for own in surface_strains(mesh, floating, training, model.loads)] == [""]
    assert surface_strains(replace(mesh, blocks=()), reduced, training, model.loads) == ()


@pytest.mark.slow
def test_figures_of_a_placement_are_those_of_its_page(artefacts, job):
    files = figures_of(job.model, (REPORT,), job.folder, "own.yaml").files
    page = (job.folder / "report.html").read_text(encoding="utf-8")
    with io.StringIO(files["figures.csv"].decode()) as index:
        captions = [row["caption"] for row in csv.DictReader(index)]
    assert sum(name.endswith(".svg") for name in files) == len(captions) > 5
    assert all(escape(caption) in page for caption in captions)
    trend = list(csv.reader(io.StringIO(files["trend.csv"].decode())))
    column = trend[0].index("tr(W P): placement criterion tr(W P) [–]")
    drawn = [float(row[column]) for row in trend[1:]]
    np.testing.assert_allclose(drawn, artefacts["place"]["/elimination/trace"], rtol=1e-8)


@pytest.mark.slow
def test_figures_of_a_bench_have_the_loads_of_its_artefact(bench, bench_config):
    job = job_of(bench_config, bench["simulate"].path.parents[1], "simulate.duration=0.3")
    files = figures_of(job.model, bench_stages(job.config)[-1:], job.folder, "own.yaml").files
    assert sum(name.endswith(".svg") for name in files) == bench["report"].summary["figures"]
    rows = list(csv.DictReader(io.StringIO(files["loads.csv"].decode())))
    simulated = bench["simulate"]
    at = np.searchsorted(simulated["/time"], float(rows[3]["time [s]"]) - 1e-9)
    np.testing.assert_allclose(float(rows[3]["Fx: load [kN]"]), simulated["/inputs/Fx"][at] / 1e3, rtol=1e-8)
