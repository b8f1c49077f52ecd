"""Gauges by their strain rows: units, the table beside them, and what does not fit together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from strainsight.cases.structure.given_gauges import read_given
from strainsight.errors import DeckError, InfeasibleError
from strainsight.gauges.given import without
from strainsight.gauges.zones import Box, NearEdges

HEAD = "gauge,x,y,z,dx,dy,dz\n"
TABLE = HEAD + "7,100,0,25,2,0,0\n3,200,0,-25,,,\n5,300.5,0,25,0,3,4\n"
COMPONENTS = np.array([0, 2, 4])


@pytest.fixture
def files(tmp_path):
    """Rows in 1/mm and 1/rad on two translations and a rotation; the table in mm."""
    sparse.save_npz(tmp_path / "rows.npz", sparse.csr_array([[1e-3, 0, 0.5], [0, 2e-3, 0], [0, 0, -0.25]]))
    (tmp_path / "gauges.csv").write_text(TABLE)
    return tmp_path / "rows.npz", tmp_path / "gauges.csv"


def test_rows_and_positions_are_converted_and_directions_made_unit(files):
    given = read_given(*files, COMPONENTS, 1e-3)
    assert np.allclose(given.rows.toarray(), [[1.0, 0, 0.5], [0, 2.0, 0], [0, 0, -0.25]])
    assert given.pool.element.tolist() == [7, 3, 5]
    assert np.allclose(given.pool.position, [[0.1, 0, 0.025], [0.2, 0, -0.025], [0.3005, 0, 0.025]])
    assert np.allclose(given.pool.direction, [[1, 0, 0], [0, 0, 0], [0, 0.6, 0.8]])
    assert not given.pool.facet.any()
    assert np.all(given.pool.nodes == -1)


def test_zones_take_rows_and_table_alike(files):
    given = read_given(*files, COMPONENTS, 1e-3)
    left = without(given, None, None, [Box((0.15, -1, -1), (0.25, 1, 1)), NearEdges(1.0)])
    assert left.pool.element.tolist() == [7, 5]
    assert np.array_equal(left.rows.toarray(), given.rows.toarray()[[0, 2]])
    with pytest.raises(InfeasibleError, match="none of the 3 given gauges"):
        without(given, None, None, [Box((-1, -1, -1), (1, 1, 1))])


@pytest.mark.parametrize(
    ("table", "said", "line"),
    [
        ("x,y,z\n1,2,3\n", "first line", 1),
        (HEAD + "1,2,3\n", "3 cells", 2),
        (HEAD + "1,0,0,0,,,\nG2,0,0,0,,,\n", "no number", 3),
        (HEAD + "1,0,,0,,,\n", "no number", 2),
        (HEAD + "1,0,nan,0,,,\n", "not finite", 2),
        (HEAD + "1,0,0,0,,,\n2,0,0,0,,,\n1,0,0,0,,,\n", "gauge 1 is there twice", 4),
        (HEAD, "no gauge", None),
    ],
)
def test_a_table_that_is_none_is_refused_at_its_line(files, table, said, line):
    rows, path = files
    path.write_text(table)
    with pytest.raises(DeckError, match=said) as caught:
        read_given(rows, path, COMPONENTS, 1.0)
    assert caught.value.where == (f"{path}:{line}" if line else str(path))


def test_rows_that_do_not_fit_the_table_or_the_matrices_are_refused(files):
    rows, table = files
    with pytest.raises(DeckError, match="3 columns, the stiffness 4 rows"):
        read_given(rows, table, np.arange(4), 1.0)
    table.write_text(TABLE + "9,0,0,0,,,\n")
    with pytest.raises(DeckError, match=r"3 rows, gauges\.csv has 4 gauges"):
        read_given(rows, table, COMPONENTS, 1.0)
