"""Formulas of MDF channels are evaluated as mpmath does, or refused; no text of a file is compiled or executed."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import mpmath
import numpy as np
import pytest

from strainsight.measurements.mdf_conversion import FUNCTIONS, evaluate
from strainsight.processes import inherited

from .written import mdf, signal

pytest.importorskip("asammdf")
X = np.array([0.125, 0.3, 0.5, 0.7, 0.9])
"""In the domain of every function."""
MP = {
    "abs": mpmath.fabs,
    "exp": mpmath.exp,
    "ln": mpmath.log,
    "log": mpmath.log,
    "log10": mpmath.log10,
    "sqrt": mpmath.sqrt,
    "pow": mpmath.power,
    **{name: getattr(mpmath, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh")},
    **{f"arc{name}": getattr(mpmath, f"a{name}") for name in ("sin", "cos", "tan")},
}
SUM, PRODUCT, SIGN, POWER, ATOM = range(5)
"""How strongly a formula holds together."""


def grown(rng, depth):
    """A random formula: text, strength, and its value of x as a function for any kind of number."""
    choice = rng.integers(8) if depth else rng.integers(2)
    if choice == 0:
        number = rng.choice(["2", "0.5", "3.", ".25", "1e-3", "1.5E+1", "7"])
        return str(number), ATOM, lambda x: x * 0 + type(x)(str(number))
    if choice == 1:
        return str(rng.choice(["X", "X1", "x1"])), ATOM, lambda x: x
    a, strength, f = grown(rng, depth - 1)
    if choice == 2:
        sign = rng.choice(["-", "+"])
        return f"{sign}{held(a, strength, SIGN, rng)}", SIGN, (lambda x: -f(x)) if sign == "-" else f
    if choice == 3:
        name = rng.choice([name for name in FUNCTIONS if name != "pow"])
        shown = name.upper() if rng.random() < 0.2 else name
        return f"{shown}({a})", ATOM, lambda x: MP[name](f(x))
    b, other, g = grown(rng, depth - 1)
    if choice == 4:
        if rng.random() < 0.3:
            return f"pow({a} , {b})", ATOM, lambda x: mpmath.power(f(x), g(x))
        power = rng.choice(["^", "**"])
        return (
            f"{held(a, strength, ATOM, rng)}{power}{held(b, other, SIGN, rng)}",
            POWER,
            lambda x: mpmath.power(f(x), g(x)),
        )
    sign = rng.choice(["+", "-"] if choice < 6 else ["*", "/"])
    level = SUM if choice < 6 else PRODUCT
    space = rng.choice(["", " "])
    text = f"{held(a, strength, level, rng)}{space}{sign}{space}{held(b, other, level + 1, rng)}"
    operator = {"+": mpmath.fadd, "-": mpmath.fsub, "*": mpmath.fmul, "/": mpmath.fdiv}[sign]
    return text, level, lambda x: operator(f(x), g(x))


def held(text, strength, needed, rng):
    return f"({text})" if strength < needed or rng.random() < 0.1 else text


def formulas(count):
    """Random formulas and their values at X, to 40 digits, without those that lose digits in double precision or are not real."""
    rng = np.random.default_rng(52)
    chosen = {}
    while len(chosen) < count:
        text, _, f = grown(rng, 4)
        try:
            with mpmath.workdps(40):
                value = [f(mpmath.mpf(float(x))) for x in X]
            with mpmath.workprec(53):
                double = [f(mpmath.mpf(float(x))) for x in X]
            well = all(abs(a / b - 1) < 1e-14 and 1e-6 < abs(a) < 1e6 for a, b in zip(value, double, strict=True))
        except (ZeroDivisionError, OverflowError, ValueError, TypeError):
            continue
        if well and len(text) > 2 and not any(isinstance(v, mpmath.mpc) for v in value):
            chosen[text] = np.array([float(v) for v in value])
    return chosen


HOSTILE = [
    '(*(eval(\'open("{marker}","w").write("x")\') for k in (1,)),)',
    "__import__('os').system('touch {marker}')",
    "[c for c in ().__class__.__base__.__subclasses__()]",
    "X1.__class__",
    "(lambda: open('{marker}','w'))()",
    "open('{marker}','w')",
    "where(X1>0,open('{marker}','w'),2)",
    "f\"{{open('{marker}','w')}}\"",
    "foo(X1)",
    "sin(X1",
    "pow(X1)",
    "2X1",
    "0x10",
    "X1 * 1,5",
    "",
    "1e999*X1",
    "9**9**9**9",
    "X1/0",
    "sqrt(-X1)",
    "ln(0*X1)",
    "１*X1",
    "(" * 3000 + "X1" + ")" * 3000,
    "-" * 900 + "X1",
    "X1" + "+X1" * 5000,
    "X1" + "^X1" * 200,
]
READ = """
import json, sys
events = []
def watch(event, arguments):
    if event in ("compile", "exec", "open", "import") or event.startswith(("socket", "subprocess", "os.")):
        caller = sys._getframe(1).f_globals.get("__name__", "")
        if event == "open" and not arguments[2] & 0x3 or "importlib" in caller:
            return
        events.append([event, repr(arguments)[:200], caller])
from pathlib import Path
from strainsight.errors import UserError
from strainsight.measurements.reader import reading
import asammdf.blocks.v4_blocks, strainsight.measurements.mdf
def caught(*arguments, **options):
    events.append(["numexpr", repr(arguments)[:200], ""])
    raise ValueError
asammdf.blocks.v4_blocks.evaluate = asammdf.blocks.v2_v3_blocks.evaluate = caught
jobs = json.load(sys.stdin)
sys.addaudithook(watch)
answers = []
for path, names in jobs:
    try:
        answers.append([values.tolist() for values, unit in reading("mdf")(Path(path), [None, *names])])
    except UserError as error:
        answers.append([error.what, error.remedy])
json.dump([answers, events, [name for name in sys.modules if name.startswith("sympy")]], sys.stdout)
"""


def written(path, channels, version):
    """channels: name → formula of it, for raw values X. asammdf writes X as X1 into version 3, wherever it stands."""
    if version < "4":
        channels = {name: re.sub(r"\bx1?\b", "X", text.lower()) for name, text in channels.items()}
    time = 1e-3 * np.arange(len(X))
    signals = [signal(name, X, time, conversion={"formula": text}) for name, text in channels.items()]
    return str(mdf(path.with_suffix(".mdf" if version < "4" else ".mf4"), ("rig", signals), version=version))


def read_apart(jobs):
    """What a process reads, or the error; what its audit hook noticed; modules of sympy."""
    command = [sys.executable, "-P", "-c", READ]
    done = subprocess.run(command, input=json.dumps(jobs), capture_output=True, text=True, env=inherited(), check=True)
    return json.loads(done.stdout)


def of_clock(folder, name, text):
    from asammdf import MDF
    from asammdf.blocks.conversion_utils import from_dict

    with MDF(written(folder / "plain", {"G1": "X1"}, "4.10")) as file:
        (group,) = file.groups
        group.channels[file.masters_db[0]].conversion = from_dict({"formula": text})
        file.save(folder / name, overwrite=True)
    return str(folder / name)


def test_formulas_are_evaluated_safely(tmp_path):
    expected = formulas(60)
    channels = {f"G{i}": text for i, text in enumerate(expected)}
    jobs = [(written(tmp_path / f"a{version[0]}", channels, version), list(channels)) for version in ("4.10", "3.30")]
    marker = tmp_path / "taken"
    for i, text in enumerate(HOSTILE):
        version = "3.30" if i % 3 == 0 and text.isascii() else "4.10"
        path = written(tmp_path / f"{i}", {"G1": text.replace("{marker}", str(marker))}, version)
        jobs.append((path, ["G1"]))
    for i, text in enumerate(("X1*2+1", f"open('{marker}','w')")):
        jobs.append((of_clock(tmp_path, f"clock{i}.mf4", text), ["G1"]))
    (first, second, *refusals, clock, refused_clock), events, symbolic = read_apart(jobs)
    for values in (first, second):
        for (text, right), value in zip(expected.items(), values[1:], strict=True):
            np.testing.assert_allclose(value, right, rtol=1e-12, err_msg=text)
    for text, (what, remedy) in zip(HOSTILE, refusals, strict=True):
        assert re.match(r"channel 'G1'(: the conversion formula '| has no physical value at sample 1: the conversion ')", what), (
            text
        )
        assert remedy
    np.testing.assert_allclose(clock[0], 2e-3 * np.arange(len(X)) + 1, rtol=1e-15)
    assert refused_clock[0].startswith("channel 'time': the conversion formula 'open(")
    assert events == []
    assert symbolic == []
    assert not marker.exists()


def test_formula_operator_precedence():
    x = np.array([3.0])
    for text, value in {
        "-X^2": -9,
        "2^3^2": 512,
        "2**-X": 1 / 8,
        "-2^-2": -0.25,
        "8/4/2": 1,
        "1-2-3": -4,
        "--X": 3,
        "log(exp(X1))": 3,
        "log10(100)": 2,
        "X1*\n2": 6,
    }.items():
        assert evaluate(text, x) == pytest.approx(value, rel=1e-15), text
