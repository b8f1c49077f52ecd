"""Views hold what the artefacts hold: places, shapes, stresses; what is not there is said with the command to run."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import UserError
from strainsight.report.view.viewed import DOTS, FACETS
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.view.surface import nearest
from strainsight.stages.view.views import chosen, offers_of, view_of

from .conftest import SHORT, finished, job_of
from .test_bench_place import written

NAMES = ("import", "rom", "train", "screen", "place", "validate", "report")


@pytest.fixture(scope="module")
def placement(artefacts, config, results):
    job = job_of(config, results, *SHORT)
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
    with pytest.raises(UserError, match="no time"):
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
    strained = view("strain", at=0.019)
    own = field["/VTKHDF/CellData/strain"].reshape(3, -1, 6)[1].astype(float)
    tensor = np.empty((len(own), 3, 3))
    for i, j, k, factor in ((0, 0, 0, 1), (1, 1, 1, 1), (2, 2, 2, 1), (0, 1, 3, 0.5), (1, 2, 4, 0.5), (0, 2, 5, 0.5)):
        tensor[:, i, j] = tensor[:, j, i] = factor * own[:, k]
    value = np.linalg.eigvalsh(tensor)
    largest = np.where(-value[:, 0] > value[:, 2], value[:, 0], value[:, 2])
    np.testing.assert_allclose(strained.panels[0].values, 1e6 * largest, rtol=1e-5)
    assert strained.unit == "µm/m"
    # the shift is the displacement of that instant times the factor that the title states
    factor = float(shown.panels[0].title.rpartition("× ")[2])
    moved = field["/VTKHDF/PointData/displacement"].reshape(3, -1, 3)[0]
    assert factor > 1
    step = int(np.argmax(stress.max(axis=1)))
    moved = field["/VTKHDF/PointData/displacement"].reshape(3, -1, 3)[step]
    np.testing.assert_allclose(shown.panels[0].shift, factor * moved, rtol=1e-5, atol=1e-12)
    with pytest.raises(UserError, match=r"from 0 to 0\.05 s"):
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


def test_modes_of_a_body_are_those_with_its_interfaces_held(beam):
    done, view = beam
    shown = view("modes")
    assert shown.panels[0].title == f"mode 1, {done['reduce']['/bodies/beam/frequency'][0]:.4g} Hz"
    points = shown.layout.points
    clamped, tip = np.abs(points[:, 0]) < 1e-9, np.abs(points[:, 0] - 2.0) < 1e-9
    for panel in shown.panels:
        largest = panel.values.max()
        # held all over the end face, through its rigid tie, and at the clamp, which leaves it free to grow in its plane
        assert panel.values[clamped].max() < 0.1 * largest
        assert panel.values[tip].max() < 1e-6 * largest


def test_candidates_of_a_bench_are_coloured_by_the_step_of_their_removal(beam):
    done, view = beam
    shown = view("candidates")
    removed, pool = done["place"]["/elimination/removed"], done["place"]["/pool/candidate"]
    assert shown.panels[0].values[0] == 1
    first = done["place"]["/candidates/position"][pool[removed[0]]]
    np.testing.assert_array_equal(shown.dots[0], first)
    assert np.sum(shown.panels[0].values == len(removed) + 1) == len(pool) - len(removed)


def test_what_is_not_there_is_reported_with_what_to_run(tmp_path, config, results):
    job = job_of(config, results, *SHORT)
    with pytest.raises(UserError, match="nothing to show yet") as caught:
        view_of(job.model, NAMES, tmp_path, "own.yaml")
    assert "strainsight import own.yaml" in str(caught.value)
    with pytest.raises(UserError, match=r"import\.h5") as caught:
        view_of(job.model, NAMES, tmp_path, "own.yaml", "modes")
    assert "strainsight rom own.yaml" in str(caught.value)


def test_the_layout_comes_first_and_before_it_the_mesh(tmp_path, config, results):
    offers = offers_of(job_of(config, results, *SHORT).model, NAMES)
    for stages, wanted in (
        (("import",), "mesh"),
        (("rom", "train", "screen"), "mesh"),
        (("place",), "layout"),
        (("validate",), "layout"),
    ):
        for stage in stages:
            (tmp_path / f"{stage}.h5").touch()
        assert chosen(offers, tmp_path, None, "own.yaml") == wanted


def test_what_a_config_does_not_have_is_refused_with_the_section_to_add(beam):
    _, view = beam
    with pytest.raises(UserError, match="no flexible body") as caught:
        view(body="beem")
    assert "did you mean beam" in str(caught.value)
    bench = BenchConfig.model_construct(sensors={}, place=None, field=None, bodies={})
    offers = offers_of(bench, ("import", "reduce", "simulate", "report"), "beam")
    assert set(offers.stages) == {"mesh", "modes"}
    assert "section `field`" in offers.absent["field"]


def test_an_instant_is_the_nearest_one():
    time = np.array([0.0, 0.1, 0.2])
    assert [nearest(time, at) for at in (-0.04, 0.04, 0.06, 0.2, 0.24)] == [0, 0, 1, 2, 2]
    with pytest.raises(UserError, match=r"from 0 to 0\.2 s"):
        nearest(time, 0.26)
    with pytest.raises(UserError):
        nearest(time, float("nan"))
