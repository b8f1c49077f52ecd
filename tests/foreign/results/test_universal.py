"""Universal files written by pyuff (dataset 55), and here by the Fortran formats of datasets 55 and 2414."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.foreign.results.reader import read_responses

from ...refusals import expect_refusal

NODES = [3, 1, 999_999_999]
SHAPE = np.arange(18, dtype=float).reshape(3, 6) / 7 - 1
MESH = "    -1\n  2411\n         1         1         1        11\n  0.0D+00  0.0D+00  0.0D+00\n    -1\n"


def lines(nodes=NODES, motion=SHAPE[:, :3]):
    return "".join(
        f"{node:10d}\n" + "".join(f"{x:13.5E}" for x in u) + "\n" for node, u in zip(nodes, motion, strict=True)
    )


def integers(*values):
    return "".join(f"{value:10d}" for value in values) + "\n"


def reals(*values):
    return "".join(f"{value:13.5E}" for value in values) + "\n"


def dataset55(
    *, analysis=2, characteristic=2, kind=8, data=2, count=3, case=1, mode=1, values=(50.0, 2.0, 0.0, 0.0), body=None
):
    titles = "NONE\nplate\nNONE\nNONE\nNONE\n"
    head = integers(1, analysis, characteristic, kind, data, count) + integers(2, 4, case, mode) + reals(*values)
    return f"    -1\n    55\n{titles}{head}{lines() if body is None else body}    -1\n"


def dataset2414(*, analysis=2, location=1, characteristic=3, kind=8, data=2, count=6, load_set=0, mode=1, body=None):
    head = integers(1) + "a name\n" + integers(location) + "NONE\n" * 3 + "wing\nNONE\n"
    head += integers(1, analysis, characteristic, kind, data, count)
    head += integers(1, 0, 1, 0, load_set, mode, 0, 0) + integers(0, 0)
    head += reals(0.0, 60.0, 0.0, 3.0, 0.0, 0.0) + reals(*[0.0] * 6)
    return f"    -1\n  2414\n{head}{lines(motion=SHAPE) if body is None else body}    -1\n"


def written(tmp_path, *datasets, name="run.unv"):
    path = tmp_path / name
    path.write_text("".join(datasets))
    return path


def test_pyuff_modes_are_read(tmp_path):
    import pyuff

    path = tmp_path / "run.uff"
    for k, frequency in enumerate([12.5, 40.0], start=1):
        motion = {f"r{i + 1}": k * SHAPE[:, i] for i in range(6)}
        dataset = pyuff.prepare_55(
            model_type=1, id1="hub", id2="NONE", id3="NONE", id4="NONE", id5="NONE", analysis_type=2, data_ch=3,
            spec_data_type=8, data_type=2, n_data_per_node=6, node_nums=NODES, load_case=4, mode_n=k, freq=frequency,
            modal_m=0.25 * k, modal_damp_vis=0.0, modal_damp_his=0.0, **motion,
        )  # fmt: skip
        pyuff.UFF(str(path))._write_set(dataset, "add" if k > 1 else "overwrite")
    first, second = read_responses(path)
    assert (first.kind, first.step, first.number, first.label) == ("mode", 4, 1, "hub")
    assert (second.number, second.frequency, second.modal_mass) == (2, 40.0, 0.5)
    assert second.node_ids.tolist() == NODES
    np.testing.assert_allclose(second.motion, 2 * SHAPE, rtol=second.rounding)
    assert not second.along_node_axes


def test_universal_datasets_55_and_2414(tmp_path):
    path = written(
        tmp_path,
        MESH,
        dataset55(analysis=1, case=7),
        dataset55(kind=2, characteristic=4, count=6, body=lines(motion=SHAPE)),
        dataset55(analysis=1, case=7),
        dataset2414(),
        dataset2414(location=2, body="         1         6\n" + reals(*range(6))),
        dataset2414(analysis=9, load_set=5),
    )
    found = list(read_responses(path))
    assert [(r.kind, r.step, r.number) for r in found] == [
        ("static", 7, 1), ("static", 7, 2), ("mode", 1, 1), ("static", 5, 1),
    ]
    np.testing.assert_allclose(found[0].motion, SHAPE[:, :3], rtol=found[0].rounding)
    np.testing.assert_allclose(found[2].motion, SHAPE, rtol=found[2].rounding)
    assert (found[2].frequency, found[2].modal_mass, found[2].label) == (60.0, 3.0, "wing")
    assert [r.label for r in found[:2]] == ["plate", "plate"]


def test_universal_shapes_may_be_accelerations(tmp_path):
    found = list(read_responses(written(tmp_path, dataset55(kind=12), dataset55(analysis=1, kind=12))))
    assert [r.kind for r in found] == ["mode"]


@pytest.mark.parametrize(
    ("dataset", "said"),
    [
        (dataset55(analysis=3, data=5), "complex modes"),
        (dataset55(analysis=4), "a transient response"),
        (dataset55(analysis=6), "a buckling shape"),
        (dataset2414(analysis=0), "an analysis of type 0"),
        (dataset55(count=4), "the vectors at the nodes have 4 values instead of 3"),
        (dataset55(body=lines().replace("  8.57143E-01", "          NaN")), r"the motion of node 999999999 is not finite"),
        (dataset55()[:-7], "the file ends inside dataset 55"),
        ("text\n", "expected the start of a dataset"),
    ],
)
def test_invalid_universal_files_are_refused(tmp_path, dataset, said):
    with expect_refusal(DeckError, said, remedy="") as caught:
        list(read_responses(written(tmp_path, dataset)))
    assert "run.unv:" in caught.value.where
