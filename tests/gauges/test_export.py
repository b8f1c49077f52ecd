"""A universal file of a layout, read back column by column as its description says."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.gauges.export import uff_text


def datasets(text: str) -> dict[int, list[str]]:
    """Number → lines, between lines of −1 in columns 1 to 6."""
    found, lines = {}, text.split("\n")
    while "    -1" in lines:
        begin = lines.index("    -1")
        end = lines.index("    -1", begin + 1)
        found[int(lines[begin + 1])] = lines[begin + 2 : end]
        lines = lines[end + 1 :]
    return found


def numbers(line: str) -> list[float]:
    """FORMAT(1P3D25.16)."""
    return [float(line[i : i + 25].replace("D", "E")) for i in range(0, len(line), 25)]


@pytest.fixture
def layout():
    rng = np.random.default_rng(0)
    position, n = rng.uniform(-1, 1, (5, 3)), rng.standard_normal((5, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    d = np.cross(n, rng.standard_normal((5, 3)))
    d /= np.linalg.norm(d, axis=1)[:, None]
    d[3], n[4] = n[3], 0.0
    return position, d, n, ["G1", "G2", "rosette é", "", "-1"]


def test_nodes_stand_at_the_gauges_each_in_a_system_of_its_own(layout):
    position, *_ = layout
    lines = datasets(uff_text(*layout))[2411]
    assert len(lines) == 10
    for i in range(5):
        assert [int(lines[2 * i][j : j + 10]) for j in (0, 10, 20)] == [i + 1, 0, i + 1]
        assert numbers(lines[2 * i + 1]) == list(position[i])


def test_systems_have_x_along_the_gauge_and_z_outward(layout):
    position, d, n, _ = layout
    part, _, *lines = datasets(uff_text(*layout))[2420]
    assert int(part) == 1
    for i in range(5):
        head, name, *matrix = lines[6 * i : 6 * i + 6]
        assert [int(head[j : j + 10]) for j in (0, 10)] == [i + 1, 0]
        x, y, z, origin = np.array([numbers(line) for line in matrix])
        np.testing.assert_array_equal(origin, position[i])
        np.testing.assert_allclose(np.array([x, y, z]) @ np.array([x, y, z]).T, np.eye(3), atol=1e-14)
        assert np.linalg.det([x, y, z]) > 0
        if i != 3:
            np.testing.assert_allclose(x, d[i], atol=1e-14)
        if i != 4:
            np.testing.assert_allclose(z, n[i], atol=1e-14)
        assert name == ["G1", "G2", "rosette ?", "NONE", "NONE -1"][i]


def test_header_and_units_are_those_of_si(layout):
    found = datasets(uff_text(*layout, title="hub", date="21-NOV-26", time="10:00:00"))
    assert list(found) == [151, 164, 2420, 2411]
    assert len(found[151]) == 7
    assert found[151][0] == "hub"
    assert found[151][6] == "21-NOV-26 10:00:00  "
    assert int(found[164][0][:10]) == 1
    assert int(found[164][0][30:40]) == 2
    assert numbers(found[164][1]) == [1.0, 1.0, 1.0]
    assert numbers(found[164][2]) == [273.15]


def test_every_line_is_ascii_and_fits_into_eighty_columns(layout):
    position, d, n, _ = layout
    text = uff_text(position, d, n, ["x" * 200, "a\nb", "ü", "   -1 ", "e"], title="t" * 100)
    assert text.isascii()
    assert max(map(len, text.split("\n"))) <= 80
    assert len(datasets(text)[2420]) == 2 + 6 * 5


def test_another_reader_finds_the_same(layout, tmp_path):
    """pyuff (MIT), where it is installed."""
    pyuff = pytest.importorskip("pyuff")
    position, d, _, _ = layout
    path = tmp_path / "layout.uff"
    path.write_text(uff_text(*layout))
    sets = {s["type"]: s for s in pyuff.UFF(str(path)).read_sets()}
    np.testing.assert_array_equal(np.column_stack([sets[2411][axis] for axis in "xyz"]), position)
    np.testing.assert_array_equal(sets[2411]["disp_cs"], np.arange(1, 6))
    assert sets[2420]["CS_sys_labels"] == [1, 2, 3, 4, 5]
    assert sets[2420]["CS_names"][:2] == ["G1", "G2"]
    matrices = np.array(sets[2420]["CS_matrices"])
    np.testing.assert_array_equal(matrices[:, 3], position)
    np.testing.assert_allclose(matrices[:3, 0], d[:3], atol=1e-14)
    assert sets[164]["length"] == 1.0
    assert sets[164]["units_code"] == 1
