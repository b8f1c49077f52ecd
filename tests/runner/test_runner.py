"""What runs, what does not, and why; who holds the lock; a stage sees what it declared and nothing else."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, UserError
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Dataset, Output
from strainsight.runner.plan import Job, plan
from strainsight.runner.runner import COMPUTING, NAME, computing, locked, run
from strainsight.runner.slices import expand, look_up, prune
from strainsight.runner.stage import Stage


def output(values, **files):
    array = np.asarray(values, dtype=float)
    return Output(
        {"/x": Dataset(array, "m", "numbers")}, {"sum": float(array.sum())}, f"{array.size} numbers", files=files
    )


def read(context):
    return output([float(line) for line in context.files["mesh.file"].read_text().split()])


def halve(context):
    return output(np.floor(context.upstream["read"]["/x"] / context.config.halve.by))


def show(context):
    if context.config.show.limit < context.upstream["halve"].summary["sum"]:
        raise InfeasibleError("too much", key="show.limit", remedy="raise it")
    return output(context.upstream["halve"]["/x"], **{"page.html": b"<html>"})


STAGES = (
    Stage("read", 1, ("mesh",), (), ("mesh.file",), read),
    Stage("halve", 1, ("halve",), ("read",), (), halve),
    Stage("show", 1, ("show",), ("halve",), (), show),
)


@pytest.fixture
def job(tmp_path):
    (tmp_path / "numbers.txt").write_text("4 6 8")
    config = {"name": "toy", "mesh": {"file": "numbers.txt"}, "halve": {"by": 2}, "show": {"limit": 100.0}}
    return Job(config, tmp_path, tmp_path / "results", lambda key: f"own.yaml:3:1#{key}")


def changed(job, **sections):
    return Job({**job.config, **sections}, job.base, job.results, job.locate)


def done(job, stages=STAGES, **options):
    return {e.stage: e.status for e in run(stages, job, **options) if e.artefact is not None}


def will_run(job, stages=STAGES):
    return {s.stage: s.reason for s in plan(stages, job) if s.status == "will run"}


def test_first_everything_runs_then_nothing(job):
    assert will_run(job) == {"read": "never run", "halve": "never run", "show": "never run"}
    assert set(done(job).values()) == {"done"}
    assert will_run(job) == {}
    assert set(done(job).values()) == {"up to date"}


def test_a_changed_key_reruns_its_stage_and_what_follows_and_names_both_values(job):
    done(job)
    new = changed(job, halve={"by": 4})
    assert will_run(new) == {"halve": "halve.by 2 → 4 (own.yaml:3)", "show": "halve changed"}
    assert done(new) == {"read": "up to date", "halve": "done", "show": "done"}


def test_an_upstream_that_comes_out_the_same_reruns_nothing_below(job):
    done(job)
    (job.base / "numbers.txt").write_text("5 7 9")
    assert "numbers.txt changed" in will_run(job)["read"]
    assert done(job) == {"read": "done", "halve": "done", "show": "up to date"}


def test_content_decides_not_the_date_of_a_file(job):
    done(job)
    os.utime(job.base / "numbers.txt", (1, 1))
    assert will_run(job) == {}


def test_a_new_stage_version_or_force_runs_again(job):
    done(job)
    newer = (Stage("read", 2, ("mesh",), (), ("mesh.file",), read), *STAGES[1:])
    assert will_run(job, newer)["read"] == "stage version 1 → 2"
    assert done(job, forced=("halve",))["halve"] == "done"


def test_a_page_that_was_altered_or_deleted_is_written_again(job):
    done(job)
    page = job.folder / "page.html"
    page.write_bytes(b"other")
    assert will_run(job) == {"show": "file page.html was altered"}
    page.unlink()
    assert will_run(job) == {"show": "file page.html is missing"}
    done(job)
    assert page.read_bytes() == b"<html>"


def test_a_damaged_artefact_runs_again(job):
    done(job)
    path = job.folder / "read.h5"
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert "damaged" in will_run(job)["read"]
    assert done(job)["read"] == "done"


def test_a_stage_that_fails_writes_nothing_and_its_key_gets_a_place(job):
    done(job)
    before = {path.name: path.read_bytes() for path in job.folder.iterdir()}
    with pytest.raises(InfeasibleError) as caught:
        done(changed(job, show={"limit": 1.0}))
    assert caught.value.where == "own.yaml:3:1#show.limit"
    assert {path.name: path.read_bytes() for path in job.folder.iterdir()} == before


def test_input_files_are_looked_for_before_anything_runs(job):
    (job.base / "numbers.txt").unlink()
    with pytest.raises(UserError, match=r"file not found: .*numbers\.txt"):
        done(job)
    assert not list(job.results.rglob("*.h5"))


def test_a_file_without_a_suffix_is_a_file_and_no_other_run(job):
    (job.base / "numbers.txt").rename(job.base / "numbers")
    assert done(changed(job, mesh={"file": "numbers"})) == dict.fromkeys(("read", "halve", "show"), "done")


def test_another_runs_result_enters_by_its_content(job):
    done(job)
    (job.results / "other").mkdir()
    (job.folder / "read.h5").rename(job.results / "other" / "validate.h5")
    user = Stage("use", 1, ("guess",), (), ("guess.from",), lambda c: output(Artefact(c.files["guess.from"])["/x"]))
    asking = Job({"name": "next", "guess": {"from": "other"}}, job.base, job.results, job.locate)
    assert done(asking, (user,)) == {"use": "done"}
    assert done(asking, (user,)) == {"use": "up to date"}
    (job.results / "other" / "validate.h5").rename(job.results / "other" / "estimate.h5")
    tested = Job({"name": "next", "guess": {"from": "other", "stage": "estimate"}}, job.base, job.results, job.locate)
    assert done(tested, (user,)) == {"use": "done"}
    with pytest.raises(UserError, match=r"run 'other' has no result \(.*validate\.h5\)"):
        done(asking, (user,))
    with pytest.raises(UserError, match="run 'nobody' has no result"):
        done(Job({"name": "next", "guess": {"from": "nobody"}}, job.base, job.results, job.locate), (user,))


def test_a_stage_may_not_read_what_it_does_not_declare(job):
    def nosy(context):
        return output([context.config.show.limit])

    with pytest.raises(AttributeError, match="show"):
        done(job, (*STAGES[:1], Stage("nosy", 1, ("halve",), (), (), nosy)))


def test_nothing_is_reused_by_force_or_from_a_damaged_file(job):
    done(job)
    other = changed(job, name="other")
    damaged = job.folder / "halve.h5"
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"x")
    reasons = {event.stage: event.reason for event in run(STAGES, other, forced=["read"]) if event.status == "done"}
    assert "reused" not in reasons["read"]
    assert "reused" not in reasons["halve"]
    assert "reused" in reasons["show"]


KEY = "f" * 64


def test_a_second_holder_is_refused_and_the_file_goes_with_the_first(tmp_path):
    with locked(tmp_path) as left_by:
        assert left_by is None
        with pytest.raises(UserError, match=r"another run \(process \d+\)"), locked(tmp_path):
            pass
    assert not (tmp_path / NAME).exists()


def test_lock_of_killed_run_is_reported_and_replaced(tmp_path):
    (tmp_path / NAME).write_text("4711\n")
    with locked(tmp_path) as left_by:
        assert left_by == 4711


def test_a_link_in_place_of_a_lock_leaves_the_file_it_names_alone(tmp_path):
    other = tmp_path / "other.txt"
    other.write_text("mine\n")
    for name in (NAME, COMPUTING):
        (tmp_path / name).symlink_to(other)
    with locked(tmp_path) as left_by, computing(tmp_path, KEY):
        assert left_by is None
    assert other.read_text() == "mine\n"


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EPERM])
def test_a_folder_that_became_read_only_meanwhile_is_no_error(tmp_path, monkeypatch, number):
    def refused(self, missing_ok=False):
        raise OSError(number, "read-only")

    with monkeypatch.context() as patched, locked(tmp_path):  # the lock is given back first
        patched.setattr(Path, "unlink", refused)
    assert (tmp_path / NAME).exists()
    with locked(tmp_path):
        pass
    assert not (tmp_path / NAME).exists()


CONFIG = {
    "seed": 1,
    "loads": {"tip": {"node": 2, "signal": {"type": "sine", "frequency": 20.0}}, "root": {"node": 1, "signal": None}},
    "parameters": {},
    "place": {"keep": 4, "estimate": ["E"]},
}


def test_a_pattern_goes_through_lists_by_their_places():
    config = {"mesh": {"terms": [{"file": "k0.op4"}, {"file": "k1.mtx", "name": "KGG"}], "other": None}}
    assert expand(config, "mesh.terms.*.file") == ["mesh.terms.0.file", "mesh.terms.1.file"]
    assert expand(config, "mesh.*.*.name") == ["mesh.terms.1.name"]
    assert expand(config, "mesh.other.*.file") == []
    assert [look_up(config, key) for key in expand(config, "mesh.terms.*.file")] == ["k0.op4", "k1.mtx"]
    assert prune(config, ("mesh.terms",)) == {"mesh": {"terms": config["mesh"]["terms"]}}


def test_a_declared_key_that_the_config_lacks_is_a_mistake_of_the_stage():
    with pytest.raises(ValueError, match=r"place\.kept"):
        prune(CONFIG, ("place.kept",))
