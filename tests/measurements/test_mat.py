"""Variables of MAT files as SciPy writes them, and of version 7.3 as MATLAB lays them out in HDF5, come back by name."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import scipy.sparse

from strainsight.errors import UserError
from strainsight.measurements.reader import read_binary

from ..refusals import expect_refusal
from .written import COUNT, A, B, T, mat5, mat73

WRITERS = [mat5, mat73]
RIG = {
    "t": T[:, None],
    "fs": 1000.0,
    "dt": 1e-3,
    "units": {"top": "N"},
    "top": A,
    "rig": {"G1": A[:, None], "G2": B[None], "deep": {"a": 2 * A, "unit": "mV/V"}, "units": {"G1": "um/m"}},
    "all": np.stack([1e3 * T, A, 2 * A], axis=1),
    "wide": np.stack([T, A]),
    "word": "hello",
}


def read(path, channels, **options):
    return read_binary("mat", path, channels, **options, sandboxed=False)


@pytest.fixture(params=WRITERS)
def rig(request, tmp_path):
    return request.param(tmp_path / "a.mat", RIG)


def test_vectors_fields_of_structs_and_their_units(rig):
    found = read(rig, ["top", "rig.G1", "rig.G2", "rig.deep.a"], time="t", time_unit="s")
    np.testing.assert_array_equal(found.time, T)
    for name, values in {"top": A, "rig.G1": A, "rig.G2": B, "rig.deep.a": 2 * A}.items():
        np.testing.assert_array_equal(found.channels[name], values)
    assert found.units == {"top": "N", "rig.G1": "um/m", "rig.G2": None, "rig.deep.a": "mV/V"}


def test_mat_matches_pymatreader(rig):
    from pymatreader import read_mat

    theirs = read_mat(rig)
    ours = read(rig, ["rig.G1", "rig.G2", "rig.deep.a", "all(:,2)"], time="t", time_unit="s").channels
    for name in ("rig.G1", "rig.G2", "rig.deep.a"):
        value = theirs
        for field in name.split("."):
            value = value[field]
        np.testing.assert_array_equal(ours[name], value)
    np.testing.assert_array_equal(ours["all(:,2)"], theirs["all"][:, 1])


def test_mat_columns_and_rows(rig):
    found = read(rig, ["all(:,3)", "all(:, 2)"], time="all(:,1)", time_unit="ms")
    np.testing.assert_allclose(found.time, T, atol=1e-15)
    np.testing.assert_array_equal(found.channels["all(:,3)"], 2 * A)
    np.testing.assert_array_equal(found.channels["all(:, 2)"], A)
    np.testing.assert_array_equal(read(rig, ["wide(2,:)"], time="wide(1,:)", time_unit="s").channels["wide(2,:)"], A)


def test_one_number_is_the_interval_or_the_rate(rig):
    np.testing.assert_allclose(read(rig, ["top"], time="dt", time_unit="s").time, T, rtol=1e-14)
    np.testing.assert_allclose(read(rig, ["top"], time="fs", time_unit="Hz").time, T, rtol=1e-14)
    np.testing.assert_allclose(read(rig, ["top"], time="dt", time_unit="ms").time, 1e-3 * T, rtol=1e-14)
    with expect_refusal(UserError, "'fs' = 1000 may be a sampling rate or a sampling interval: its unit is s", remedy="unit: Hz"):
        read(rig, ["top"], time="fs", time_unit="s")
    with pytest.raises(UserError, match="unit of time in the config is unknown: 'Hz'"):
        read(rig, ["top"], time="t", time_unit="Hz")


@pytest.mark.parametrize(
    ("name", "said", "remedy"),
    [
        ("Top", "variable 'Top' not found", "did you mean top?"),
        ("rig.G1.x", "'rig.G1' is not|variable 'rig.G1.x' not found", ""),
        ("rig", "'rig' is a struct", "use a field"),
        ("word", "'word' (is text|contains char)", "plain vector"),
        ("all", "'all' is a matrix of size 400", r"as in 'all(:,1)'"),
        ("all(:,4)", r"'all\(:,4\)' does not exist: the size of the matrix is 400", "numbered from 1"),
    ],
)
def test_nonvector_variables_are_refused(rig, name, said, remedy):
    with expect_refusal(UserError, said, remedy=remedy):
        read(rig, [name], time="t", time_unit="s")


def test_cells_struct_arrays_sparse_and_complex_are_refused(tmp_path):
    cells = np.empty(2, object)
    cells[:] = [A, B]
    refused = {
        "cells": (cells, "struct array or cell array with 2"),
        "many": (np.zeros(2, [("a", object)]), "struct array or cell array with 2"),
        "thin": (scipy.sparse.csc_array(np.eye(3)), "sparse matrix"),
        "z": (A + 1j, "complex numbers"),
        "cube": (np.ones((2, 2, 2)), "matrix of size 2 × 2 × 2"),
    }
    path = mat5(tmp_path / "a.mat", {"t": T, **{name: value for name, (value, _) in refused.items()}})
    for name, said in [*((name, said) for name, (_, said) in refused.items()), ("many.a", "'many' is a struct array")]:
        with pytest.raises(UserError, match=said):
            read(path, [name], time="t", time_unit="s")


def never_written(file):
    file.create_dataset("a", (1, COUNT), float, chunks=(1, 100))


def a_table(file):
    file["a"] = np.zeros((1, 6), "u4")
    file["a"].attrs["MATLAB_object_decode"] = 3


@pytest.mark.parametrize(
    ("fill", "said"),
    [
        (never_written, "0 of 4 blocks"),
        (a_table, "'a' is a MATLAB table or object"),
        (lambda file: file.__setitem__("a", h5py.ExternalLink("other.h5", "/a")), "the dataset links to another file"),
        (lambda file: file.create_dataset("a", (1, 8), float, external=[("o.raw", 0, 64)]), "in another file"),
        (lambda file: file.create_dataset("a", (1, 10**12), float, chunks=(1, 1000)), "'a' has 1000000000000 samples"),
    ],
)
def test_invalid_version_73_variables_are_refused(tmp_path, fill, said):
    path = mat73(tmp_path / "a.mat", {"t": T})
    with h5py.File(path, "r+") as file:
        fill(file)
    with pytest.raises(UserError, match=said):
        read(path, ["a"], time="t", time_unit="s")


def test_different_lengths_are_refused(rig):
    with pytest.raises(UserError, match="'dt' has 1 samples, but the time axis has 400"):
        read(rig, ["top", "dt"], time="t", time_unit="s")
