"""An artefact that exists is complete, and what it holds is what was written."""

from __future__ import annotations

import errno
import os
import time
from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.errors import ArtefactError, UserError
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.runner import output as contents
from strainsight.runner import store
from strainsight.runner.artefact import Artefact, ArtefactHeader, seal
from strainsight.runner.output import Dataset, Output, Table
from strainsight.runner.store import write_artefact

HEADER = ArtefactHeader("place", 1, "k" * 64, {"place": {"keep": 4}}, {"screen": "s" * 64}, {"mesh.file": "m" * 64}, seed=7)


def output(scale: float = 1.0, **changes) -> Output:
    time = np.arange(5) * 0.1
    content = {
        "datasets": {
            "/time": Dataset(time, "s", "time"),
            "/strain": Dataset(scale * np.outer(time, [1.0, -2.0]), "strain", "(time × gauge)", ("/time", "/name")),
            "/name": Dataset(np.array(["σ", "G2"]), "1", "names"),
            "/flag": Dataset(np.array([True, False]), "1", "flags"),
            "/empty": Dataset(np.zeros((0, 3)), "m", "nothing"),
            "/number": Dataset(np.array(3.5), "m", "a scalar"),
            "/reduced/mass/constant": Dataset(np.eye(2), "1", "constant"),
            "/reduced/mass/E": Dataset(np.ones((2, 2)), "1", "slope"),
            "/VTKHDF/Types": Dataset(np.array([10], dtype=np.uint8), "", ""),
        },
        "summary": {"pool": 100, "gap": 0.5, "truth": "perturbed", "identified": True, "std.E": np.float64(2.0)},
        "message": "100 → 4",
        "tables": (Table("Gauges", ("gauge", "x [m]"), (("G1", "0.1"),)),),
        "attributes": {
            "/VTKHDF": {"Version": (2, 2), "Type": np.bytes_("UnstructuredGrid")},
            "/strain": {"rule": "mean"},
        },
        "files": {"report.html": b"<html>"},
    }
    return Output(**(content | changes))


@pytest.mark.parametrize("held", [0, contents.IN_MEMORY])
def test_artefact_roundtrip(tmp_path, monkeypatch, held):
    monkeypatch.setattr(contents, "IN_MEMORY", held)
    written = write_artefact(tmp_path / "run" / "place.h5", output(), HEADER)
    artefact = Artefact(written.path)
    assert (artefact._contents["/strain"].array is None) == (held == 0)
    assert artefact["/strain"].tolist() == output().datasets["/strain"].array.tolist()
    assert artefact["/name"].tolist() == ["σ", "G2"]
    assert artefact["/flag"].dtype == bool
    assert artefact["/empty"].shape == (0, 3)
    assert artefact["/number"] == 3.5
    assert sorted(artefact.children("/reduced/mass")) == ["E", "constant"]
    assert artefact.groups("/reduced") == ("mass",)
    assert artefact.summary == output().summary
    assert artefact.tables == output().tables
    assert artefact.message == "100 → 4"
    assert artefact.attributes("/strain")["rule"] == "mean"
    assert (artefact.key, artefact.header.upstream, artefact.header.seed) == (HEADER.key, HEADER.upstream, 7)
    assert (tmp_path / "run" / "report.html").read_bytes() == b"<html>"
    assert "/tables" not in artefact.paths()


def test_obsolete_file_is_removed_unless_modified(tmp_path):
    path, names = tmp_path / "estimate.h5", ("a.csv", "b.csv", "c.csv")
    write_artefact(path, output(files={name: name.encode() for name in names}), HEADER)
    (tmp_path / "b.csv").write_bytes(b"my own notes")
    (tmp_path / "d.csv").write_bytes(b"another file")
    write_artefact(path, output(files={"c.csv": b"c.csv"}), HEADER)
    assert sorted(own.name for own in tmp_path.glob("*.csv")) == ["b.csv", "c.csv", "d.csv"]


def test_replaced_record_is_kept_as_backup(tmp_path):
    for content in (b"one", b"one", b"two", b"one"):
        made = output(files={"gauges.csv": content})
        write_artefact(tmp_path / "place.h5", made, HEADER, records=("gauges.csv",))
        assert (tmp_path / "gauges.csv").read_bytes() == content
    kept = {path.read_bytes() for path in tmp_path.glob("gauges-*.csv")}
    assert kept == {b"one", b"two"}
    assert len([*tmp_path.glob("gauges-*.csv")]) == 2


def test_every_dataset_has_unit_and_axes(tmp_path):
    path = write_artefact(tmp_path / "a.h5", output(), HEADER).path
    with h5py.File(path) as file:
        strain = file["strain"]
        assert strain.attrs["units"] == "strain"
        assert strain.attrs["description"] == "(time × gauge)"
        assert [strain.dims[axis][0].name for axis in (0, 1)] == ["/time", "/name"]
        provenance = "format format_version package_version stage created python numpy h5py scipy numba mkl blas processor"
        assert {*provenance.split(), "commit", "seed"} <= set(file.attrs)
        assert not any(str(tmp_path) in str(value) for value in file.attrs.values())


def test_grid_has_sibling_file_for_vtk(tmp_path):
    grid = unstructured_grid(np.eye(3), (), {"rank": np.arange(3)})
    raw = {f"/VTKHDF/{path}": Dataset(array, "", "") for path, array in grid.datasets.items()}
    content = Output(raw, {}, "", attributes={f"/VTKHDF/{path}".rstrip("/"): own for path, own in grid.attributes.items()})
    write_artefact(tmp_path / "old" / "place.h5", content, HEADER)
    (tmp_path / "old").rename(tmp_path / "moved")
    read = pyvista.read(tmp_path / "moved" / "place.vtkhdf")
    assert (read.n_points, list(read.point_data)) == (3, ["rank"])
    write_artefact(tmp_path / "moved" / "train.h5", Output({}, {}, ""), HEADER)
    assert [path.name for path in sorted((tmp_path / "moved").iterdir())] == ["place.h5", "place.vtkhdf", "train.h5"]


def test_grid_file_array_names_contain_units(tmp_path):
    """VTK reads under those names what the artefact has under its own, instant by instant."""
    time, stress = np.array([0.0, 0.5, 0.75]), np.arange(12.0).reshape(3, 4)
    grid = unstructured_grid(np.eye(4, 3), (), {"stress": stress, "rank": np.arange(4)}, steps=time)
    datasets, attributes = vtkhdf_datasets(grid)
    assert attributes["/VTKHDF/PointData/stress"] == {"units": "Pa"}
    write_artefact(tmp_path / "field.h5", Output(datasets, {}, "", attributes=attributes), HEADER)
    with h5py.File(tmp_path / "field.h5") as file:
        assert set(file["VTKHDF/PointData"]) == {"stress", "rank"}
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "field.vtkhdf"))
    for step in range(3):
        reader.SetStep(step)
        reader.Update()
        shown = pyvista.wrap(reader.GetOutput())
        assert set(shown.point_data) == {"stress [Pa]", "rank"}
        np.testing.assert_array_equal(shown.point_data["stress [Pa]"], stress[step])


def test_the_digest_is_of_the_content_alone(tmp_path):
    first = write_artefact(tmp_path / "a.h5", output(), HEADER)
    again = write_artefact(tmp_path / "b.h5", output(), ArtefactHeader("place", 2, "other", {}, {}, {}))
    assert again.digest == first.digest
    changes = [
        output(scale=1 + 1e-15),
        output(summary=output().summary | {"pool": 101}),
        output(message="100 → 5"),
        output(datasets={k: v for k, v in output().datasets.items() if k != "/flag"}),
        output(datasets=output().datasets | {"/flag": Dataset(np.array([1, 0], dtype=np.int8), "1", "flags")}),
        output(attributes={**output().attributes, "/strain": {"rule": "worst"}}),
    ]
    digests = {write_artefact(tmp_path / "c.h5", changed, HEADER).digest for changed in changes}
    assert len(digests | {first.digest}) == len(changes) + 1


def test_a_failure_while_writing_leaves_the_last_good_artefact(tmp_path, monkeypatch):
    path = tmp_path / "place.h5"
    good = write_artefact(path, output(), HEADER)
    before = sorted(tmp_path.iterdir())

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(store, "_write_header", killed)
        with pytest.raises(KeyboardInterrupt):
            write_artefact(path, output(scale=2.0), HEADER)
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            write_artefact(path, output(scale=2.0), HEADER)
    assert Artefact(path).digest == good.digest
    assert sorted(tmp_path.iterdir()) == before


def test_flipped_byte_is_refused_before_hdf5(tmp_path, monkeypatch):
    """A byte of HDF5's own metadata can hold its library for ever, so the checksum in front of the file comes first."""
    path = write_artefact(tmp_path / "a.h5", output(), HEADER).path
    whole = path.read_bytes()
    monkeypatch.setattr(h5py, "File", None)
    for spot in np.random.default_rng(0).integers(0, len(whole), 300):
        path.write_bytes(whole[:spot] + bytes([whole[spot] ^ 0x10]) + whole[spot + 1 :])
        with pytest.raises(ArtefactError, match=r"damaged|not written by strainsight") as failure:
            Artefact(path)
        assert failure.value.where == str(path)
        assert failure.value.remedy


def test_numbers_changed_by_another_program_are_noticed(tmp_path):
    path = write_artefact(tmp_path / "a.h5", output(), HEADER).path
    with h5py.File(path, "a") as file:
        file["strain"][0, 0] = 1.0
    seal(path)
    with pytest.raises(ArtefactError, match="checksum of the content"):
        Artefact(path)


def test_missing_or_foreign_file_is_refused(tmp_path):
    with pytest.raises(ArtefactError, match="results file not found"):
        Artefact(tmp_path / "none.h5")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = 1.0
    with pytest.raises(ArtefactError, match="not a strainsight results file"):
        Artefact(tmp_path / "foreign.h5")
    path = write_artefact(tmp_path / "a.h5", output(), HEADER).path
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = 99
    seal(path)
    with pytest.raises(ArtefactError, match="format version 99"):
        Artefact(path)


def outside(file, other):
    file["link"] = h5py.ExternalLink(str(other), "/secret")


def external_storage(file, other):
    file.create_dataset("raw", (4,), "f8", external=[(str(other), 0, 32)])


def virtual(file, other):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "secret", (3,))
    file.create_virtual_dataset("virtual", layout)


def huge(file, other):
    file.create_dataset("huge", (10**13,), "f8", chunks=(1024,))


def ring(file, other):
    file["reduced/again"] = file["/"]


def compressed(file, other):
    file.create_dataset("bomb", data=np.zeros(10**6), compression="gzip")


def ladder(file, other):
    """Ten names a level: 10¹⁰ paths through eleven groups."""
    below = file.create_group("level0")
    for level in range(1, 11):
        group = file.create_group(f"level{level}")
        for i in range(10):
            group[f"name{i}"] = below
        below = group


def loop(file, other):
    file.create_group("a/b")
    file["a/b/c"] = file["a"]


def nested(file, other):
    file.create_group("/".join(["deep"] * 2000))


def crowd(file, other):
    """As many groups as MAX_OBJECTS allows below that."""
    group = file.create_group("crowd")
    for i in range(1 << 7):
        group.create_group(str(i))


def repeated_text(file, other):
    """An array of text, whose entries may all point to the same object of the heap."""
    file["strain"].attrs["rules"] = ["x", "y"]


@pytest.mark.parametrize(
    "attack",
    [
        outside, external_storage, virtual, huge, ring, compressed, ladder, loop, nested, crowd, repeated_text,
    ],
)
def test_file_with_external_links_or_oversized_claims_is_refused(tmp_path, monkeypatch, attack):
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = np.ones(3)
    path = write_artefact(tmp_path / "a.h5", output(), HEADER).path
    with h5py.File(path, "a") as file:
        attack(file, other)
    seal(path)
    monkeypatch.setattr(contents, "MAX_OBJECTS", 100)
    start = time.process_time()
    with pytest.raises(ArtefactError, match="damaged"):
        Artefact(path)
    assert time.process_time() - start < 1.0


def test_reserved_space_exceeds_file_size(tmp_path):
    """The HDF5 library takes the process down where the disk is full: it must never have to ask for more."""
    many = {f"/many/{i}": Dataset(np.ones(i), "m", "x" * i) for i in range(1, 80)}
    words = {"/words": Dataset(np.array(["w" * i for i in range(90)], dtype=object), "1", "words")}
    for i, content in enumerate([output(), output(datasets=many), output(datasets=words), output(datasets={})]):
        content = content if i == 0 else replace(content, attributes={})
        path = write_artefact(tmp_path / f"{i}.h5", content, HEADER).path
        assert path.stat().st_size < store._most_bytes(content, HEADER)


def test_full_disk_is_reported_before_hdf5(tmp_path, monkeypatch):
    numbers = {path: own for path, own in output().datasets.items() if not path.startswith("/VTKHDF")}
    more = {"datasets": numbers, "attributes": {}}
    good = write_artefact(tmp_path / "a.h5", output(**more), HEADER)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    monkeypatch.setattr(h5py, "File", None)
    with pytest.raises(UserError, match=r"a\.h5  the file cannot be written: No space left on device\n .*--results DIR"):
        write_artefact(tmp_path / "a.h5", output(**more), replace(HEADER, key="other"))
    monkeypatch.undo()
    assert Artefact(tmp_path / "a.h5").digest == good.digest
    assert {path.name for path in tmp_path.iterdir()} == {"a.h5", "report.html"}
