"""A record is written, read and listed by what its fields say; shapes that contradict each other are found where they arise."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from strainsight.errors import ArtefactError
from strainsight.records.record import dataset, group, listed, read, record, written
from strainsight.workflow.artefact import Artefact, Header
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.store import write_artefact


@record
class Body:
    mass: float = dataset("/mass", "kg", "", "its mass")
    names: tuple[str, ...] = dataset("/names", "1", "frame", "its frames")


@record
class Run:
    time: np.ndarray = dataset("/time", "s", "/time", "time")
    strain: np.ndarray = dataset("/strain", "strain", "/time × channel", "readings")
    direction: np.ndarray = dataset("/direction", "1", "channel × 3", "directions")
    noise: np.ndarray | None = dataset("/noise", "unit of the channel", "channel", "its noise", default=None)
    estimate: dict[str, np.ndarray] = dataset("/estimate/<name>", "unit of <name>", "/time", "estimate of <name>")
    bodies: dict[str, Body] = group("/bodies/<name>")
    first: Body = group("/first")
    bonded: np.ndarray | None = dataset("/glued", "m", "bonded", "distance", default=None)


@dataclass(frozen=True)
class Affine:
    """As a kernel has it."""

    constant: np.ndarray
    slopes: dict[str, np.ndarray]


@record
class AffineForm:
    constant: np.ndarray = dataset("/constant", "1/s", "row × row", "constant term")
    slopes: dict[str, np.ndarray] = dataset("/<name>", "1/s per SI unit", "row × row", "slope in <name>")

    @classmethod
    def of(cls, value: Affine) -> AffineForm:
        return cls(constant=value.constant, slopes=value.slopes)

    def made(self) -> Affine:
        return Affine(self.constant, self.slopes)


@record
class Model:
    damping: Affine = group("/damping", AffineForm)


@record
class History:
    value: np.ndarray = dataset("/value", "<unit>", "sample", "history of <what>")


@record
class Histories:
    loads: dict[str, History] = group("/loads/<name>", unit="unit of <name>", what="<name>")


def run_of(**changes) -> Run:
    given = {
        "time": np.arange(4.0),
        "strain": np.ones((4, 2)),
        "direction": np.eye(3)[:2],
        "estimate": {"E": np.full(4, 2e11), "tip": np.zeros(4)},
        "bodies": {"hub": Body(mass=3.5, names=("a", "b")), "blade": Body(mass=1.0, names=())},
        "first": Body(mass=2.0, names=("c",)),
    }
    return Run(**(given | changes))


UNITS = {"E": "Pa", "tip": "N"}


def stored(folder, datasets) -> Artefact:
    return write_artefact(folder / "toy.h5", Output(datasets, {}, "toy"), Header("toy", 1, "key", {}, {}, {}))


def test_what_is_written_is_read_again(tmp_path):
    run = run_of()
    found = read(Run, stored(tmp_path, written(run, UNITS)))
    assert isinstance(found, Run)
    for name in ("time", "strain", "direction"):
        np.testing.assert_array_equal(getattr(found, name), getattr(run, name))
    assert list(found.estimate) == ["E", "tip"]
    np.testing.assert_array_equal(found.estimate["E"], run.estimate["E"])
    assert {name: (body.mass, body.names) for name, body in found.bodies.items()} == {
        "hub": (3.5, ("a", "b")),
        "blade": (1.0, ()),
    }
    assert found.first.mass == 2.0
    assert found.bonded is None


def test_units_names_and_labels_of_axes_are_those_of_the_fields():
    datasets = written(run_of(), UNITS)
    assert datasets["/estimate/E"].unit == "Pa"
    assert datasets["/estimate/tip"].description == "estimate of tip"
    assert datasets["/strain"].scales == ("/time", "")
    assert datasets["/time"].scales == ()
    assert "/glued" not in datasets


def test_the_unit_of_several_is_stated_when_they_are_written():
    datasets = written(run_of(noise=np.ones(2)), UNITS | {"the channel": "strain or m"})
    assert datasets["/noise"].unit == "strain or m"


def test_records_by_name_take_unit_and_words_of_their_name():
    loads = {name: History(value=np.zeros(2)) for name in ("E", "tip")}
    datasets = written(Histories(loads=loads), UNITS)
    assert {path: (own.unit, own.description) for path, own in datasets.items()} == {
        "/loads/E/value": ("Pa", "history of E"),
        "/loads/tip/value": ("N", "history of tip"),
    }
    assert listed(Histories) == [("/loads/<name>/value", "sample", "unit of <name>", "history of <name>")]


def test_a_field_is_read_when_it_is_asked_for():
    asked = []

    class Source:
        def __getitem__(self, path):
            asked.append(path)
            return np.arange(4.0)

        def __contains__(self, path):
            return True

        def children(self, path):
            raise AssertionError(path)

        groups = children

    found = read(Run, Source(), "/there")
    assert asked == []
    assert found.time is found.time
    assert asked == ["/there/time"]


def test_lengths_that_contradict_each_other_are_not_written():
    with pytest.raises(ValueError, match=r"/strain has 3 along '/time' and /time says 4"):
        written(run_of(strain=np.ones((3, 2))), UNITS)
    with pytest.raises(ValueError, match=r"/direction has 2 along '3' and its definition says 3"):
        written(run_of(direction=np.ones((2, 2))), UNITS)
    with pytest.raises(ValueError, match="/strain has 1 axes, not 2"):
        written(run_of(strain=np.ones(4)), UNITS)
    with pytest.raises(ValueError, match="/time of Run is missing"):
        written(run_of(time=None), UNITS)


def test_lengths_that_contradict_each_other_in_a_file_are_named_where_they_are_read(tmp_path):
    datasets = written(run_of(), UNITS) | {"/direction": Dataset(np.eye(3), "1", "one too many")}
    found = read(Run, stored(tmp_path, datasets))
    assert found.strain.shape == (4, 2)
    with pytest.raises(ArtefactError, match="/direction has 3 along 'channel' and /strain says 2"):
        _ = found.direction


def test_the_list_for_the_manual_has_every_dataset_once():
    rows = {path: (axes, unit) for path, axes, unit, _ in listed(Run)}
    assert rows["/strain"] == ("time × channel", "strain")
    assert rows["/bodies/<name>/mass"] == ("scalar", "kg")
    assert rows["/first/names"] == ("frame", "1")
    assert rows["/noise"] == ("channel", "unit of the channel")
    assert len(rows) == len(listed(Run)) == 10


def test_a_dataclass_of_a_kernel_stands_through_its_form(tmp_path):
    model = Model(damping=Affine(np.eye(2), {"E": np.ones((2, 2))}))
    datasets = written(model)
    assert sorted(datasets) == ["/damping/E", "/damping/constant"]
    found = read(Model, stored(tmp_path, datasets)).damping
    assert isinstance(found, Affine)
    np.testing.assert_array_equal(found.constant, np.eye(2))
    assert list(found.slopes) == ["E"]


def test_a_record_that_was_read_goes_to_another_process_whole(tmp_path):
    found = pickle.loads(pickle.dumps(read(Run, stored(tmp_path, written(run_of(), UNITS)))))
    (tmp_path / "toy.h5").unlink()
    assert type(found) is Run
    assert found.bodies["hub"].names == ("a", "b")
    np.testing.assert_array_equal(found.strain, np.ones((4, 2)))
