"""docs/artefacts.md lists every dataset with its rank and unit, and nothing else."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from strainsight.decks.reader import read_mesh
from strainsight.records.mesh import MeshColumns
from strainsight.records.record import written
from strainsight.workflow.artefact import Header
from strainsight.workflow.output import Output
from strainsight.workflow.store import write_artefact

from ..edges.beam import finished
from ..records.test_record import DECK
from ..solids import SOLIDS
from .test_faces import MESH, WEIGHT, of_density

DOC = Path(__file__).parents[2] / "docs" / "artefacts.md"
STAGES = (
    "import",
    "modes",
    "rom",
    "train",
    "screen",
    "observe",
    "place",
    "validate",
    "report",
    "reduce",
    "bearing",
    "simulate",
)
BELOW_KIND = {
    "<kind>": f"({'|'.join(SOLIDS)})",
    "<name>": r"(?!constant$)[\w-]+",
    "<parameter>": r"(?!constant$)[\w-]+",
    "<case>": r"[\w+]+",
}
ONLY_SOMETIMES = (
    r"/bodies/.*/(stiffness|damping|reach)/\(\?|/reduced/(mass|input_slope)/\(\?|/matrices/|/gauges/given/|/gauges/arms/|/glued/|/sweep/"
    r"|/elimination/metric|/selected/greedy/load|/clearance/|/load_cases/|/arm_peak|^/installation$"
    r"|^/drives/|^/shells/|^/beams/|^/sections/|^/laminae/|^/results/|^/anisotropic/|^/orientations/|^/composites/|/lumped$|/contacts$|/(factors|roots|weights)/|^/gauges/row_change/"
)
"""Where a body has free moduli (test_bench_out_of_range.py), a density is a parameter, and a load acts on it, or errors of
installation are avoided (a test of their own below); where stiffness and mass, or strain rows, come from files (test_ready.py),
or modes and static responses do (test_results.py); where gauges are bonded already (test_sensors.py) or bridges
(test_bridges.py, test_bridge_patterns.py); where sweeps are asked for (test_estimate.py); by another criterion than the trace
(tests/cli/test_criteria.py); of the final set only; where a clearance is kept (test_clearance.py); where load cases are placed
for (test_load_cases.py); where mass is lumped (tests/fem/test_lumped.py) or surfaces are in contact (test_contact.py);
where joints are driven (test_bench_driven.py); of shells, beams and anisotropic materials (a test of their own below); where a
stiffness is no multiple of its parameter (test_laminated.py); where a thickness is free (test_thickness.py)."""


UNITS_OF = {
    "unit of <name>": ("N", "N m", "m", "rad", "Pa", "kg/m^3"),
    "unit of the channel": ("strain", "m/s^2", "m", "strain or m/s^2", "strain or m", "strain or m/s^2 or m"),
    "unit of the intensity": ("strain^2 s", "(strain or m/s^2)^2 s"),
    "unit of the row": ("strain/(kg^1/2 m)", "(strain or m)/(kg^1/2 m)"),
    "unit of the biased channel": ("strain",),
    "unit of the variance": ("strain^2",),
    "unit of the candidate": ("strain", "strain or m"),
    "unit of input <name>": ("N", "N m"),
    "unit of the loads": ("N", "N m", "N or N m"),
    "unit of parameter <name>": ("m", "Pa"),
    "unit of sensor <name>": ("strain", "m or rad", "m", "m/s", "1"),
}
"""What the unit of a name may be."""


def rows(stage: str) -> list[tuple[str, int, str]]:
    """(pattern of the path, rank, unit) of every row under the stage's heading."""
    text = DOC.read_text(encoding="utf-8").split(f"## {stage}.h5\n")[1].split("\n## ")[0]
    found = []
    for path, shape, unit in re.findall(r"^\| `(/[^`]+)` \| ([^|]+) \| ([^|]+) \|", text, flags=re.MULTILINE):
        pattern = re.escape(path)
        for placeholder, meaning in {**BELOW_KIND, "<i>": r"\d+"}.items():
            pattern = pattern.replace(re.escape(placeholder), meaning)
        found.append((pattern, 0 if shape.strip() == "scalar" else shape.count("×") + 1, unit.strip()))
    return found


@pytest.fixture(scope="module")
def every(artefacts, bench):
    """stage → artefact, of a placement and of a bench; both have an `import`, that of the placement is meant."""
    return {**bench, **artefacts}


@pytest.mark.parametrize("stage", STAGES)
def test_every_dataset_is_listed_with_its_rank_and_unit(every, stage):
    paths = [path for path in every[stage].paths() if not path.startswith("/VTKHDF")]
    assert_listed(stage, every[stage], paths)


def assert_listed(stage, artefact, paths):
    """Each once, with its rank and unit."""
    listed = rows(stage)
    for path in paths:
        matching = [(rank, unit) for pattern, rank, unit in listed if re.fullmatch(pattern, path)]
        assert len(matching) == 1, path
        rank, unit = matching[0]
        assert artefact[path].ndim == rank, path
        attributes = artefact.attributes(path)
        assert attributes["description"]
        assert attributes["units"] in UNITS_OF.get(unit, (unit,)), path


def test_what_a_density_under_its_weight_and_avoided_errors_add_is_listed(tmp_path):
    run = finished(tmp_path, "screen", MESH, of_density(WEIGHT) | {"tolerances": {"gain": 0.01}})
    assert_listed("rom", run["rom"], ["/reduced/mass/rho", "/reduced/input_slope/rho"])
    assert_listed("screen", run["screen"], ["/installation"])


def test_what_shells_beams_and_anisotropic_materials_add_is_listed_and_there(tmp_path):
    (tmp_path / "own.bdf").write_text(DECK)
    datasets = written(MeshColumns.of(read_mesh(tmp_path / "own.bdf")))
    artefact = write_artefact(tmp_path / "import.h5", Output(datasets, {}, "toy"), Header("import", 1, "key", {}, {}, {}))
    own = ("/shells/", "/beams/", "/sections/", "/laminae/", "/anisotropic/", "/orientations/")
    paths = [path for path in artefact.paths() if path.startswith(own)]
    assert_listed("import", artefact, paths)
    for pattern, _, _ in rows("import"):
        if pattern.startswith(own):
            assert any(re.fullmatch(pattern, path) for path in paths), pattern


@pytest.mark.parametrize("stage", STAGES)
def test_every_listed_dataset_is_in_the_file(every, stage):
    paths = every[stage].paths()
    for pattern, _, _ in rows(stage):
        if re.search(ONLY_SOMETIMES, pattern):
            continue
        assert any(re.fullmatch(pattern, path) for path in paths), pattern


@pytest.mark.parametrize("stage", STAGES)
def test_every_summary_scalar_is_listed(every, stage):
    text = DOC.read_text(encoding="utf-8").split(f"## {stage}.h5\n")[1].split("\n## ")[0]
    listed = re.findall(r"`([^`]+)`", text.split("Summary:")[1])
    for name in every[stage].summary:
        assert any(
            re.fullmatch(re.escape(entry).replace("<name>", r"[\w-]+").replace("<case>", r"[\w+]+"), name)
            for entry in listed
        ), name


def test_the_tables_are_those_of_the_records():
    spec = importlib.util.spec_from_file_location("artefact_reference", DOC.parent / "artefact_reference.py")
    reference = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference)
    text = DOC.read_text(encoding="utf-8")
    assert reference.renewed(text) == text, "python docs/artefact_reference.py writes the tables anew"
