"""The strain of the surface that a view and the page show: that of the finite elements as VTK interpolates them, in µm/m."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import pyvista as pv
import vtkmodules.vtkCommonCore

from strainsight.cases.structure.contour import surface_strains
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.report.view.viewed import FACETS
from strainsight.stages.view.strain import strain_view
from strainsight.stages.view.views import view_of

from .conftest import SHORT, job_of

NAMES = ("import", "rom", "train", "screen", "place", "validate", "report")


@pytest.fixture(scope="module")
def job(config, results):
    return job_of(config, results, *SHORT)


@pytest.fixture(scope="module")
def strain(job):
    return view_of(job.model, NAMES, job.folder, "own.yaml", "strain")[0]


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
    assert alone.title == "tip alone, 1\u00a0kN at rest"
    assert (strain.on, strain.unit, strain.quantity) == (FACETS, "µm/m", "principal strain of largest size")
    corner = strain.layout.points[strain.layout.faces[:, :4]]
    x, z = corner.mean(axis=1)[:, 0], corner.mean(axis=1)[:, 2]
    inner = (np.abs(np.abs(z) - 0.095) < 1e-9) & (x > 0.4) & (x < 1.6)
    assert inner.sum() > 50
    bent = -1e6 * 1000.0 * (2.0 - x) * z / (1.89e11 * 0.25 * 0.19**3 / 12)
    np.testing.assert_allclose(alone.values[inner], bent[inner], rtol=0.01)


def test_a_training_run_is_shown_at_its_largest_strain_energy(strain, artefacts):
    run = strain.panels[-1]
    q, K = artefacts["train"]["/coordinate"], read(Reduced, artefacts["rom"]).model
    K = K.stiffness.at(K.reference)
    k = max(range(len(q)), key=lambda i: q[i] @ K @ q[i])
    assert run.title == f"training run, t = {artefacts['train']['/time'][k]:.4g} s"
    grid = pv.read(artefacts["import"].path.with_suffix(".vtkhdf"))
    u = (artefacts["rom"]["/basis"] @ q[k]).reshape(-1, 3)
    for i in facets_of(run.values):
        middle = strain.layout.points[strain.layout.faces[i, :4]].mean(axis=0)
        found = largest_by_vtk(grid, middle, u)
        assert run.values[i] == pytest.approx(found, rel=1e-6)


def test_the_page_offers_them_with_their_scales_and_the_modes_with_their_frequencies(strain, artefacts):
    page = (artefacts["report"].path.parent / "report.html").read_text()
    offered = re.search(r'<select id="space-shape">(.*?)</select>', page, re.DOTALL)[1]
    strains, modes = re.findall(r"<optgroup.*?</optgroup>", offered)
    captions = re.findall(r">([^<>]+)</option>", strains)
    assert [text.replace("\u00a0", " ") for text in captions] == [p.title.replace("\u00a0", " ") for p in strain.panels]
    frequency = artefacts["rom"]["/frequency"][:6]
    assert re.findall(r">([^<>]+)</option>", modes) == [f"mode {i}, {f:.4g} Hz" for i, f in enumerate(frequency, 1)]
    bars = re.findall(
        r'<div data-state="(\d)" hidden>.*?<p>(.*?)</p>.*?<span>(.*?)</span>.*?<span>([^<]*)</span></p></div>'
        r'<p class="note">From <data value="(\S+?)".*? to <data value="(\S+?)"',
        page,
    )
    assert [(state, title) for state, title, *_ in bars] == [
        (str(i), "principal strain of largest size [µm/m]") for i in range(len(strain.panels))
    ]
    for panel, (*_, low, high, least, most) in zip(strain.panels, bars, strict=True):
        assert [float(least), float(most)] == pytest.approx([panel.values.min(), panel.values.max()], rel=1e-9)
        largest = np.abs(panel.values).max()  # both signs: about zero
        ends = [float(text.replace("−", "-")) for text in (low, high)]
        assert ends == pytest.approx([-largest, largest], rel=6e-3)


def test_before_anything_is_placed_the_strain_is_shown_without_gauges(job, results, tmp_path):
    import shutil

    for stage in ("import", "rom", "train"):
        shutil.copy(job.folder / f"{stage}.h5", tmp_path)
    view, read_from = view_of(job.model, NAMES, tmp_path, "own.yaml", "strain")
    assert read_from == ("import", "rom", "train")
    assert view.layout.gauges == ()
    assert len(view.panels) == 2


def test_what_floats_has_no_strain_at_rest_and_no_solid_none_at_all(strain, artefacts, job):
    reduced, training = read(Reduced, artefacts["rom"]), read(Training, artefacts["train"])
    mesh, model = mesh_from(artefacts["import"]), job.model
    assert isinstance(model, PlacementConfig)
    K = reduced.model.stiffness
    loose = replace(K, constant=0 * K.constant, terms={name: 0 * term for name, term in K.terms.items()})
    floating = replace(reduced, model=replace(reduced.model, stiffness=loose))
    assert [own.load for own in surface_strains(mesh, floating, training, model.loads)] == [""]
    none = surface_strains(replace(mesh, blocks=()), reduced, training, model.loads)
    assert none == ()
    with pytest.raises(UserError, match="no solids"):
        strain_view("", strain.layout, none)
