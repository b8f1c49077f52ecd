"""Universal files: by hand from the Fortran formats, and by pyuff as an independent writer."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.uff58_file import read_uff58

from ..refusals import expect_refusal

UNITS_SI = "    -1\n   164\n         1SI: mks (Newton)            2\n" + "  1.0D+00" * 3 + "\n  2.7D+02\n    -1\n"


def head(
    count, *, node=12, direction=3, kind=1, data=2, even=1, start=0.0, step=1e-3, abscissa=17, ordinate=3,
    time_label="NONE", unit="NONE", below="NONE", id_line="gauge 1",
):  # fmt: skip
    return "".join(
        line + "\n"
        for line in (
            id_line, "NONE", "01-May-24 12:00:00", "NONE", "NONE",
            f"{kind:5d}{7:10d}{1:5d}{0:10d} {'NONE':10s}{node:10d}{direction:4d} {'NONE':10s}{0:10d}{0:4d}",
            f"{data:10d}{count:10d}{even:10d}{start:13.5E}{step:13.5E}{0:13.5E}",
            f"{abscissa:10d}{0:5d}{0:5d}{0:5d} {'Time':20s} {time_label:20s}",
            f"{ordinate:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {unit:20s}",
            f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {below:20s}",
            f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}",
        )
    )  # fmt: skip


def text(values, **header):
    body = numbers(values, **header)
    header.pop("time", None)
    return f"    -1\n    58\n{head(len(values), **header)}{body}    -1\n"


def numbers(values, *, data=2, even=1, time=None, **_):
    """Records 12: 6E13.5, 4E20.12 or 2(E13.5,E20.12)."""
    ordinate = "{:20.12E}" if data == 4 else "{:13.5E}"
    fields = [ordinate.format(v) for v in values]
    if not even:
        fields = [f"{t:13.5E}{field}" for t, field in zip(time, fields, strict=True)]
    per_line = {(2, 1): 6, (4, 1): 4, (2, 0): 3, (4, 0): 2}[data, even]
    rows = ["".join(fields[i : i + per_line]) for i in range(0, len(fields), per_line)]
    return "".join(row + "\n" for row in rows)


def binary(values, *, order="<", time=None, time_type="f4", newline=b"", **header):
    number = f"{order}f{8 if header.get('data', 2) == 4 else 4}"
    rows = np.zeros(len(values), [("x", order + time_type), ("y", number)] if time is not None else [("y", number)])
    rows["y"] = values
    if time is not None:
        rows["x"] = time
    content = rows.tobytes()
    line = f"{58:6d}b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{len(content):12d}{0:6d}{0:6d}{0:12d}{0:12d}\n"
    start = ("    -1\n" + line + head(len(values), even=int(time is None), **header)).encode()
    return start + content + newline + b"    -1\n"


A = np.random.default_rng(0).normal(size=101)
UNEVEN = np.cumsum(np.random.default_rng(1).uniform(0.5e-3, 1.5e-3, 101))
NODES = "    -1\n    15\n        12         0         0        11  0.00000E+00  0.00000E+00  0.00000E+00\n    -1\n"


@pytest.fixture
def read(tmp_path):
    def from_content(content, channels=("12:3",), **options):
        path = tmp_path / "test.uff"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("cp1252"))
        return read_uff58(path, channels, **options)

    return from_content


HAND = """\
    -1
    58
Gauge at the root
NONE
01-May-24 12:00:00
NONE
NONE
    1         0    0         0 NONE             101  -2 NONE                0   0
         2         8         1  1.00000E+00  5.00000E-01  0.00000E+00
        17    0    0    0 Time                 s
         3    0    0    0 Strain               \u00b5m/m
         0    0    0    0 NONE                 NONE
         0    0    0    0 NONE                 NONE
  1.00000E+00 -2.00000E+00  3.00000E+00-4.00000E+100  5.00000D+00  6.00000-105
          NaN  8.00000E+00
    -1
"""


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("name", ["101:-2", "101:-Y", "Gauge at the root"])
def test_handwritten_uff58_is_read(read, name, end):
    # A number of thirteen signs touches its neighbour, and Fortran drops the E of three-digit exponents.
    content = HAND.replace("-4.00000E+100", "-4.0000E+100 ").replace("\n", end)
    found = read(content, [name])
    np.testing.assert_array_equal(found.time, 1 + 0.5 * np.arange(8))
    np.testing.assert_array_equal(found.channels[name], [1, -2, 3, -4e100, 5, 6e-105, np.nan, 8])
    assert found.units == {name: "µm/m"}


@pytest.mark.parametrize("data", [2, 4])
@pytest.mark.parametrize("even", [1, 0])
@pytest.mark.parametrize("count", [2, 3, 6, 24, 101])
def test_all_uff58_text_formats(read, data, even, count):
    found = read(text(A[:count], data=data, even=even, time=UNEVEN[:count], step=1e-3 if even else 0.0))
    np.testing.assert_allclose(found.channels["12:3"], A[:count], rtol=1e-12 if data == 4 else 1e-5)
    np.testing.assert_allclose(found.time, 1e-3 * np.arange(count) if even else UNEVEN[:count], rtol=1e-5)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("newline", [b"", b"\n", b"\r\n"])
@pytest.mark.parametrize(("data", "time_type"), [(2, None), (2, "f4"), (4, None), (4, "f4"), (4, "f8")])
def test_all_uff58_binary_formats(read, data, order, newline, time_type):
    uneven = {} if time_type is None else {"time": UNEVEN, "time_type": time_type}
    # Values that look like the end of a line and of a dataset must not end it.
    values = np.concatenate([A[2:], np.frombuffer(b"\n    -1\n    -1\n\n", "<f8")])
    content = binary(values, order=order, data=data, newline=newline, **uneven)
    found = read(
        NODES.encode() + content + binary(2 * values, order=order, data=data, node=13, **uneven), ["13:3", "12:3"]
    )
    exact = values.astype("f4") if data == 2 else values
    np.testing.assert_array_equal(found.channels["12:3"], exact)
    np.testing.assert_array_equal(found.channels["13:3"], (2 * values).astype("f4") if data == 2 else 2 * values)
    if time_type is not None:
        np.testing.assert_array_equal(found.time, UNEVEN.astype(time_type))


def test_units_from_the_label_or_from_si(read):
    functions = [
        text(A, node=1, ordinate=12), text(A, node=2, ordinate=12, unit="g"), text(A, node=3, ordinate=3),
        text(A, node=4, ordinate=0, unit="mV", below="V"), text(A, node=5, ordinate=13),
    ]  # fmt: skip
    names = ["1:+Z", "2:+Z", "3:+Z", "4:+Z", "5:+Z"]
    assert list(read("".join(functions), names).units.values()) == [None, "g", None, "mV/V", None]
    assert list(read(UNITS_SI + "".join(functions), names).units.values()) == ["m/s2", "g", None, "mV/V", "N"]


def test_uff58_time_unit_from_label(read):
    np.testing.assert_allclose(read(text(A, time_label="ms", step=2.0)).time, 2e-3 * np.arange(101))
    np.testing.assert_allclose(read(text(A, time_label="Seconds")).time, 1e-3 * np.arange(101))
    with pytest.raises(UserError, match="the time unit is ms in the config, but s in the file"):
        read(text(A), time_unit="ms")
    with pytest.raises(UserError, match="unknown: 'rpm'"):
        read(text(A, time_label="rpm"))


def test_ambiguous_functions_use_id_lines(read):
    content = text(A, id_line="left") + text(2 * A, id_line="right")
    np.testing.assert_allclose(read(content, ["right"]).channels["right"], 2 * A, rtol=1e-5)
    with pytest.raises(UserError, match="'12:3' is the name of 2 functions: 'left',"):
        read(content)
    with pytest.raises(UserError, match="function 'rigth' not found") as caught:
        read(content, ["rigth"])
    assert caught.value.remedy == "did you mean right?"


TEXT = text(A)
BINARY = binary(A, data=4)
DATA = 14
"""Line of the first values of TEXT."""


def line(number, new):
    lines = TEXT.splitlines(keepends=True)
    lines[number - 1] = new + "\n"
    return "".join(lines)


FAULTS = {
    "is no number": (line(DATA + 2, "  1.00000E+00        stuff" + "  0.0" * 10), f":{DATA + 2}", "'stuff' is not a number"),
    "overflow": (line(DATA + 2, "*************" * 6), f":{DATA + 2}", "exceeds its column"),
    "infinite": (line(DATA, "     Infinity" * 6), f":{DATA}", "sample 1 of channel .12:3. is infinite"),
    "too many": (TEXT.replace(f"{101:10d}", f"{90:10d}"), f":{DATA + 15}", "the function has more than the declared 90 values"),
    "cut": (TEXT[:-20], ":", "the file ends inside dataset 1"),
    "claims": (TEXT.replace(f"{101:10d}", f"{10**9:10d}"), ":2", "1000000000 values are declared"),
    "form": (TEXT.replace(f"{2:10d}{101:10d}", f"{3:10d}{101:10d}"), ":9", "ordinate type 3, 101 values,"),
    "increment": (text(A, step=0.0), f":{DATA}", "the time increment is 0"),
    "spectrum": (text(A, kind=2), f":{DATA}", "function type 2"),
    "no mark": ("hello\n" + TEXT, ":1", "expected the start of a dataset, but found 'hello'"),
    "binary cut": (BINARY[:-50], "dataset 1 (12:3)", "the dataset does not end after 101 values of 8 bytes"),
    "VAX": (BINARY.replace(f"{2:6d}{11:12d}".encode(), f"{1:6d}{11:12d}".encode()), ":2", "numbers of DEC VMS"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named_with_their_place(read, fault):
    content, place, said = FAULTS[fault]
    with expect_refusal(UserError, said, remedy="") as caught:
        read(content)
    assert place in caught.value.where


def test_channels_of_two_clocks_are_refused(read):
    with pytest.raises(UserError, match=r"the channels have 2 different sampling rates: 1000 Hz .'12:3'., 500 Hz .'13:3'."):
        read(TEXT + text(A, node=13, step=2e-3), ["12:3", "13:3"])
    with pytest.raises(UserError, match="no channels are specified"):
        read(TEXT, [])


def test_unrequested_functions_are_not_checked(read):
    complex_text = (
        "    -1\n    58\n" + head(2, node=7, data=5, kind=4, abscissa=18) + "  1.00000E+00" * 4 + "\n    -1\n"
    )
    np.testing.assert_allclose(read(complex_text + TEXT).channels["12:3"], A, rtol=1e-5)
    with pytest.raises(UserError, match="complex values"):
        read(complex_text + TEXT, ["7:3"])


@pytest.mark.parametrize("coded", [0, 1])
@pytest.mark.parametrize("even", [0, 1])
def test_pyuff_roundtrip(tmp_path, coded, even):
    pyuff = pytest.importorskip("pyuff")
    t = 2 + np.arange(101) / 1024
    writer = pyuff.UFF(str(tmp_path / "test.uff"))
    axes, units = ("abscissa", "ordinate", "orddenom", "z_axis"), ("len", "force", "temp")
    zeros = {f"{axis}_{unit}_unit_exp": 0 for axis in axes for unit in units}
    zeros |= dict.fromkeys(
        ("load_case_id", "ref_node", "ref_dir", "orddenom_spec_data_type", "z_axis_spec_data_type"), 0
    )
    none = dict.fromkeys(["id2", "id3", "id4", "id5", "rsp_ent_name", "ref_ent_name"], "NONE")
    none |= dict.fromkeys(["orddenom_axis_units_lab", "z_axis_axis_units_lab"], "NONE")
    for node in (5, 6):
        record = pyuff.prepare_58(
            binary=coded, id1=f"gauge {node}", func_type=1, ver_num=1, rsp_node=node, rsp_dir=-1, abscissa_spacing=even,
            z_axis_value=0.0, abscissa_spec_data_type=17, abscissa_axis_units_lab="s", ordinate_spec_data_type=3,
            ordinate_axis_units_lab="um/m", data=node * A, x=t, **zeros, **none,
        )  # fmt: skip
        writer.write_sets(record, "add")
    found = read_uff58(tmp_path / "test.uff", ["6:-X", "gauge 5"])
    np.testing.assert_allclose(found.channels["6:-X"], 6 * A, rtol=0 if coded else 1e-11)
    np.testing.assert_allclose(found.channels["gauge 5"], 5 * A, rtol=0 if coded else 1e-11)
    assert found.units["6:-X"] == "um/m"
    np.testing.assert_allclose(found.time, t, rtol=0 if coded and not even else 5e-6)
