"""The result file that comes with ansys-mapdl-reader: modes of a free-standing block of hexahedra."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.results import ansys, apart
from strainsight.decks.results.reader import read_responses
from strainsight.errors import DeckError


@pytest.fixture(scope="module")
def file():
    from ansys.mapdl.reader import examples

    return examples.rstfile


@pytest.fixture(scope="module")
def ours(file):
    return list(read_responses(file))


def test_modes_are_those_that_the_library_reads_here(file, ours):
    from ansys.mapdl.reader import read_binary

    theirs = read_binary(file)
    assert [(r.kind, r.step, r.number) for r in ours] == [("mode", 1, k) for k in range(1, 7)]
    np.testing.assert_array_equal([r.frequency for r in ours], theirs.time_values)
    for row, response in enumerate(ours):
        ids, motion = theirs.nodal_solution(row)
        np.testing.assert_array_equal(response.node_ids, ids)
        np.testing.assert_array_equal(response.motion, motion)


def test_shapes_of_a_symmetric_block_come_in_equal_pairs_and_are_orthogonal(ours):
    modes = ours
    assert modes[0].frequency == pytest.approx(modes[1].frequency, rel=1e-9)
    assert abs(np.vdot(modes[0].motion, modes[1].motion)) < 1e-6 * np.vdot(modes[0].motion, modes[0].motion)


class Made:
    """What the library makes of a file: two load steps, and components in an order of their own."""

    def __init__(self, analysis, names=("ROTZ", "UZ", "UY", "UX", "ROTX", "ROTY", "TEMP"), cyclic=False, complex_=0):
        table = np.array([[1, 1, 1], [2, 3, 2]])
        self._resultheader = {"kan": analysis, "cpxrst": complex_, "ls_table": table, "title": " a run "}
        self._is_cyclic, self.names, self.n_results, self.time_values = cyclic, names, 2, np.array([5.0, 8.0])

    def result_dof(self, row):
        return self.names

    def nodal_solution(self, row):
        columns = {"UX": 1, "UY": 2, "UZ": 3, "ROTX": 4, "ROTY": 5, "ROTZ": 6, "TEMP": 7}
        values = np.array([[10 * node + columns[name] for name in self.names] for node in (4, 2)], dtype=float)
        return np.array([4, 2], dtype=np.int32), (row + 1) * values


def read_here(made, monkeypatch):
    monkeypatch.setattr("ansys.mapdl.reader.read_binary", lambda path: made)
    return list(ansys.responses(Path("run.rst"), Path("copy.rst")))


def test_static_results_with_rotations_in_our_order_of_components(monkeypatch):
    first, second = read_here(Made(0), monkeypatch)
    assert [(r.kind, r.step, r.number, r.frequency, r.label) for r in (first, second)] == [
        ("static", 1, 1, 0.0, "a run"),
        ("static", 2, 3, 0.0, "a run"),
    ]
    assert second.node_ids.tolist() == [4, 2]
    np.testing.assert_array_equal(second.motion, 2.0 * (np.array([[40], [20]]) + np.arange(1, 7)))
    assert read_here(Made(2, names=("UX", "UY", "UZ")), monkeypatch)[1].frequency == 8.0


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (Made(1), "a buckling analysis"),
        (Made(3), "a harmonic analysis"),
        (Made(4), "a transient analysis"),
        (Made(7), "an analysis of type 7"),
        (Made(2, cyclic=True), "a cyclic analysis"),
        (Made(2, complex_=1), "complex results"),
        (Made(0, names=("UX", "UY", "TEMP")), "without UZ"),
        (Made(0, names=("TEMP",)), "without UX, UY, UZ"),
    ],
)
def test_other_results_are_refused_by_name(monkeypatch, made, said):
    with pytest.raises(DeckError, match=said) as caught:
        read_here(made, monkeypatch)
    assert caught.value.remedy


def test_a_disk_without_room_for_the_copy_is_named(file, monkeypatch):
    def full(path, copy):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(apart, "copyfile", full)
    with pytest.raises(DeckError, match=r"cannot be copied to the temporary folder .*: No space left on device") as caught:
        list(read_responses(file))
    assert "TMPDIR" in caught.value.remedy


def test_without_the_library_the_command_that_installs_it_is_named(file, monkeypatch):
    monkeypatch.setattr(ansys, "MODULE", "no_such_package.reader")
    with pytest.raises(DeckError, match="ansys-mapdl-reader, which is not installed") as caught:
        list(read_responses(file))
    assert caught.value.remedy == 'install it: pip install "strainsight[results]"'


def test_a_file_cut_short_is_refused(file, tmp_path):
    path = tmp_path / "run.rst"
    path.write_bytes(Path(file).read_bytes()[:300_000])
    with pytest.raises(DeckError) as caught:
        list(read_responses(path))
    assert "run.rst" in caught.value.where
    assert caught.value.remedy


def test_a_reader_that_dies_costs_the_file_and_not_the_run(file, monkeypatch):
    monkeypatch.setattr(ansys, "COMMAND", [sys.executable, "-c", "print('ready', flush=True)"])
    with pytest.raises(DeckError, match="ansys-mapdl-reader crashed, or did not come to an end"):
        list(read_responses(file))
