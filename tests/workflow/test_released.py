"""Artefacts of released versions: read where their format allows, else refused by version and remedy, never taken for others."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
from typer.testing import CliRunner

from strainsight.errors import ArtefactError
from strainsight.records.artefacts import BENCH, PLACEMENT
from strainsight.records.record import read
from strainsight.workflow import artefact as artefacts
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.plan import UP_TO_DATE, plan
from strainsight_cli.main import app

from .release import KEPT, LARGEST, TINY, job_of, stages_of, unpacked

RELEASED = sorted(path.name.removesuffix(".tar.xz") for path in KEPT.glob("*.tar.xz"))
RECORDS = {"structure": PLACEMENT, "bench": PLACEMENT | BENCH}


@pytest.fixture(scope="module", params=RELEASED)
def folder(request, tmp_path_factory):
    return unpacked(request.param, tmp_path_factory.mktemp("released"))


def stages(folder, name):
    """Stage, and its artefact, of those that the release has."""
    job = job_of(folder, name)
    found = [(stage, job.folder / f"{stage.name}.h5") for stage in stages_of(job)]
    return [(stage, path) for stage, path in found if path.exists()]


def opened(path):
    """The artefact, or None and the error."""
    try:
        return Artefact(path), ""
    except ArtefactError as error:
        return None, str(error)


def test_there_are_some_and_they_are_small():
    assert "0.1.0" in RELEASED
    assert all((KEPT / f"{version}.tar.xz").stat().st_size < LARGEST for version in RELEASED)


@pytest.mark.parametrize("name", TINY)
def test_every_artefact_opens_or_names_its_version_and_the_remedy(folder, name):
    found = stages(folder, name)
    assert len(found) >= (6 if name == "bench" else 9)
    for stage, path in found:
        own, error = opened(path)
        if own is None:
            assert "format version" in error
            assert "--force" in error
            continue
        assert own.header.stage == stage.name
        assert own.message
        for dataset in own.paths():
            assert own[dataset].size >= 0


@pytest.mark.parametrize("name", TINY)
def test_every_record_of_the_same_stage_version_is_whole_and_of_another_says_so(folder, name):
    for stage, path in stages(folder, name):
        if stage.name not in RECORDS[name]:
            continue
        own, _ = opened(path)
        if own is None:  # the test above says how
            continue
        record = read(RECORDS[name][stage.name], own)
        for field in fields(RECORDS[name][stage.name]):
            error = ""
            try:
                getattr(record, field.name)
            except ArtefactError as raised:
                error = str(raised)
            assert not error or own.header.version != stage.version, f"{stage.name}: {error}"
            assert not error or "--force" in error


@pytest.mark.parametrize("name", TINY)
def test_what_another_stage_version_made_is_never_up_to_date(folder, name):
    job = job_of(folder, name)
    statuses = {status.stage: status for status in plan(stages_of(job), job)}
    for stage, path in stages(folder, name):
        version, status = Artefact(path).header.version, statuses[stage.name]
        if version != stage.version:
            assert status.status != UP_TO_DATE
            assert f"stage version {version} → {stage.version}" in status.reasons
        raised = [replace(own, version=own.version + (own.name == stage.name)) for own in stages_of(job)]
        later = next(own for own in plan(raised, job) if own.stage == stage.name)
        assert later.status != UP_TO_DATE
        assert f"stage version {version} → {stage.version + 1}" in later.reasons


def test_another_format_is_refused_by_both_numbers_and_computed_anew(folder, monkeypatch):
    monkeypatch.setattr(artefacts, "FORMAT_VERSION", 99)
    job = job_of(folder, "structure")
    with pytest.raises(ArtefactError, match=r"format version \d+, by strainsight [\d.]+; this one reads version 99") as caught:
        Artefact(job.folder / "rom.h5")
    assert "--force" in caught.value.remedy
    first = plan(stages_of(job), job)[0]
    assert first.status != UP_TO_DATE
    assert any("reads version 99" in reason for reason in first.reasons)


@pytest.mark.parametrize("name", TINY)
def test_the_command_line_says_it_without_a_traceback(folder, name):
    done = CliRunner().invoke(app, ["status", str(folder / f"{name}.yaml"), "--results", str(folder / "results")])
    assert done.exit_code == 0, done.output
    assert "Traceback" not in done.output


def test_a_release_is_not_replaced_by_chance(monkeypatch, capsys):
    from . import release

    monkeypatch.setattr(release.sys, "argv", ["release"])
    assert release.main() == 2
    assert "is kept already" in capsys.readouterr().err
