"""The estimate of a bench: what is refused, what it writes, and the bench of the manual."""

from __future__ import annotations

import re
import shutil

import pytest
from typer.testing import CliRunner

from strainsight.errors import ConfigError
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from .conftest import BANK, DIAMETER, LOADS, ROOT, SMALL, job_of
from .test_artefacts import UNITS_OF


@pytest.mark.parametrize(
    ("config", "change", "key", "what"),
    [
        (LOADS, "sensors.gauges.gauges=[{position: [0.918, 0.94, -1.372], direction: [0, 0, 1]}]", "estimate.sensors",
         "1 channels for 3 unknown loads"),
        (LOADS, "estimate.sensors.gauge={noise: 1.0e-7}", "estimate.sensors.gauge", "did you mean gauges"),
        (LOADS, "estimate.inputs.weight={std: 1.0, increment: 1.0}", "estimate.inputs.weight", "no force or moment"),
        (LOADS, "estimate.sensors.gauges.noise=[1.0e-7, 1.0e-7]", "estimate.sensors.gauges.noise", "2 noises for 4"),
        (LOADS, "estimate.time_step=0.07", "estimate.time_step", "does not divide"),
        (DIAMETER, "estimate.parameters.diameter.guess=0.066", "estimate.parameters.diameter.guess", "would not pass a ball"),
        (LOADS, "estimate.parameters.Fx={bearing: pitch-bearing, property: preload, std: 1.0e-6}", "estimate.parameters.Fx",
         "a load of the estimate has the same name"),
        (SMALL, "estimate.truth.model=own", "estimate.truth.model", "beside measurements"),
        (LOADS, "estimate.truth={model: other, step: 0.03}", "estimate.truth.step", "do not divide the filter's step"),
        (LOADS, "estimate.truth={model: other, duration: 1.0}", "estimate.truth.duration", "it ends after 1 s"),
        (LOADS, "estimate.truth={model: other, histories: 3}", "estimate.truth.histories", "all of them are the same"),
        (LOADS, "estimate.truth.histories=3", "estimate.truth.histories", "a truth 'fine' has none"),
        (DIAMETER, "estimate.parameters.diameter.starts=[0.066]", "estimate.parameters.diameter.starts", "would not pass"),
        (DIAMETER, "estimate.parameters.diameter={guess: 0.0606, std: 1.0e-4}", "estimate.parameters.diameter", "no modulus"),
        (LOADS, BANK, "estimate.method.parameters", "no parameter is estimated"),
        (DIAMETER, "estimate.method={parameters: bank, update: one_shot}", "estimate.method.update", "a form of the extended"),
        (LOADS, "estimate.method={noise: as_printed, step_error: estimated}", "estimate.method.step_error", "change after it"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_with_their_place(config, change, key, what):
    with pytest.raises(ConfigError) as refused:
        job_of(config, ROOT, change)
    assert refused.value.key == key
    assert what in str(refused.value)


def test_every_dataset_and_number_is_listed_in_the_docs(estimate, bench):
    text = (ROOT / "docs" / "artefacts.md").read_text(encoding="utf-8")
    text = text.split("## estimate.h5 of a bench\n")[1].split("\n## ")[0]
    rows = {}
    for path, shape, unit in re.findall(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \|", text, flags=re.MULTILINE):
        pattern = re.escape(path).replace("<name>", r"[\w.-]+")
        rows[pattern] = 0 if shape.strip() == "scalar" else shape.count("×") + 1, unit.strip()
    scalars = [
        re.escape(name).replace("<name>", r"[\w-]+").replace("<i>", r"\d+")
        for name in re.findall(r"`([^`]+)`", text.split("Summary:")[1])
    ]
    found = [
        estimate(DIAMETER, "estimate.duration=0.9", "estimate.runs=2", "estimate.sensors.gauges.bias=1.0e-8"),
        estimate(DIAMETER, "estimate.duration=0.3", BANK),
        estimate(SMALL, "estimate.duration=0.5", f"estimate.measured.from={bench['simulate'].path}", "estimate.hold_out=each"),
    ]
    seen = set()
    for artefact in found:
        for path in artefact.paths():
            (pattern,) = [pattern for pattern in rows if re.fullmatch(pattern, path)]
            seen.add(pattern)
            rank, unit = rows[pattern]
            assert artefact[path].ndim == rank, path
            assert artefact.attributes(path)["units"] in UNITS_OF.get(unit, (unit,)), path
        for name in artefact.summary:
            assert any(re.fullmatch(scalar, name) for scalar in scalars), name
    assert seen == set(rows)


PLACED = ("sensors.gauges={type: strain, body: beam, layout: place}",)


@pytest.fixture(scope="module")
def from_scratch(tmp_path_factory):
    """The config of the manual beside its mesh: its runs take the beam over from each other."""
    folder = tmp_path_factory.mktemp("scratch")
    text = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8").split("## A bench from scratch\n```yaml\n")[1]
    (folder / "beam.yaml").write_text(text.split("```")[0], encoding="utf-8")
    shutil.copy(ROOT / "meshes" / "cantilever.bdf", folder)
    return folder


@pytest.mark.parametrize(
    ("more", "last"),
    [
        ((), "estimate"),
        (("estimate.parameters={E: {guess: 2.3e+11, std: 2.0e+10}}",), "estimate"),
        ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 2}"), "estimate"),
        ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 3}"), "place"),
    ],
)
def test_the_bench_of_the_manual_runs_as_it_says(from_scratch, tmp_path, more, last):
    name, results = f"beam-{tmp_path.name}", from_scratch / "r"
    options = [part for change in (f"name={name}", *more) for part in ("--set", change)]
    done = CliRunner().invoke(app, [last, str(from_scratch / "beam.yaml"), "--results", str(results), *options])
    assert done.exit_code == 0, done.output
    found = Artefact(results / name / f"{last}.h5").summary
    assert found["error.F"] < 0.1 if last == "estimate" else found["selected"] == 3
