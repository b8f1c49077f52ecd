"""python -m tests.mutants KERNEL [--only MODULE …] [--count 200] [--seconds 20] [--seed 10]: who notices small faults.

A sample of the places where a comparison, an operator, a number or a condition of a kernel can be changed. Each fault is
made in a copy and run by those of the kernel's fast tests that reach its line, quickest first, as many as take so many
seconds. What no test notices is printed for a person to judge: nothing that comes out is changed, or a gap in the tests.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import coverage

WORK = Path("build/mutants")
_SWAPPED = (
    "Lt LtE, Gt GtE, Eq NotEq, Is IsNot, In NotIn, And Or, Add Sub, Mult Div, BitAnd BitOr, min max, any all, "
    "argmin argmax, zeros ones, minimum maximum, sum prod"
)
_ONE_WAY = {"Pow": "Mult", "MatMult": "Mult", "FloorDiv": "Div", "Mod": "FloorDiv"}
OTHER = _ONE_WAY | {a: b for pair in _SWAPPED.split(", ") for a, b in (pair.split(), pair.split()[::-1])}


def faults(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in the place of a node."""

    def changed(old: ast.AST, **fields: object) -> ast.AST:
        new = copy.copy(old)
        vars(new).update(fields)
        return new

    def swapped(op: ast.AST) -> ast.AST:
        return getattr(ast, OTHER[type(op).__name__])()

    match node:
        case ast.Compare(ops=ops):
            for at, op in enumerate(ops):
                yield changed(node, ops=[*ops[:at], swapped(op), *ops[at + 1 :]])
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) if type(op).__name__ in OTHER:
            yield changed(node, op=swapped(op))
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Constant(value=bool(value)):
            yield changed(node, value=not value)
        case ast.Constant(value=int(value) | float(value)):
            yield changed(node, value=value + 1 if isinstance(value, int) else 2 * value or 1.0)
        case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name) as func) if name in OTHER:
            yield changed(
                node, func=changed(func, **{"attr" if isinstance(func, ast.Attribute) else "id": OTHER[name]})
            )
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            yield changed(node, test=ast.UnaryOp(ast.Not(), test))
        case ast.Expr(value=ast.Call()) | ast.Break() | ast.Continue():
            yield ast.copy_location(ast.Pass(), node)


def places(source: str) -> list[tuple[int, int]]:
    """(node in the order of `ast.walk`, which of its faults), without messages, annotations and decorators."""
    nodes, idle = list(ast.walk(ast.parse(source))), set()
    for node in nodes:
        parts = [getattr(node, name, None) for name in ("annotation", "returns", "exc")] + getattr(
            node, "decorator_list", []
        )
        idle |= {id(inner) for part in parts if part is not None for inner in ast.walk(part)}
    return [
        (at, which) for at, node in enumerate(nodes) if id(node) not in idle for which, _ in enumerate(faults(node))
    ]


def with_fault(source: str, at: int, which: int) -> tuple[str, int, str]:
    """The faulty module, the line, and in words what was changed."""
    tree = ast.parse(source)
    old = list(ast.walk(tree))[at]
    new = list(faults(old))[which]
    said = " -> ".join(ast.unparse(node).split("\n")[0] for node in (old, new))

    class Put(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> ast.AST:
            return new if node is old else self.generic_visit(node)

    return ast.unparse(ast.fix_missing_locations(Put().visit(tree))), old.lineno, said


def run(*arguments: str, **more: object) -> bool:
    """Whether Python ends well with these arguments."""
    return subprocess.run([sys.executable, "-m", *arguments], check=False, **more).returncode == 0


def tests_by_line(kernel: str) -> tuple[coverage.CoverageData, dict[str, float]]:
    """Which tests of a kernel reach what, and how long each takes [s]."""
    settings, data, times = (WORK / f"{kernel}.{ending}" for ending in ("ini", "coverage", "xml"))
    settings.write_text(f"[run]\nsource=strainsight.{kernel}\ndynamic_context=test_function\ndata_file={data}\n")
    of_kernel = ("-m", "not slow", f"--junit-xml={times}", f"tests/{kernel}")
    if not run("coverage", "run", f"--rcfile={settings}", "-m", "pytest", "-q", "-p", "no:cov", *of_kernel):
        sys.exit("the tests have to pass before anything is changed")
    took: dict[str, float] = {}
    for case in ElementTree.parse(times).iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name', '').split('[')[0]}"
        took[name] = took.get(name, 0.0) + float(case.get("time", 0.0))
    measured = coverage.CoverageData(str(data))
    measured.read()
    return measured, took


def passes(tests: list[str], pipeline: Path, patience: float) -> bool:
    """Whether these tests pass on the sources there, in time [s]."""
    named = [f"{where.replace('.', '/')}.py::{name}" for where, _, name in (test.rpartition(".") for test in tests)]
    env = {**os.environ, "PYTHONPATH": str(pipeline), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        return run("pytest", "-x", "-m", "not slow", *named, env=env, stdout=subprocess.DEVNULL, timeout=patience)
    except subprocess.TimeoutExpired:
        return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kernel")
    for name, default in (("--count", 200), ("--seconds", 20), ("--seed", 10)):
        parser.add_argument(name, type=int, default=default)
    parser.add_argument("--only", nargs="+", metavar="MODULE")
    asked = parser.parse_args()
    copied = WORK.resolve() / "pipeline"
    shutil.copytree("pipeline", copied, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    measured, took = tests_by_line(asked.kernel)
    modules = sorted(Path("pipeline/strainsight", asked.kernel).rglob("*.py"))
    modules = [module for module in modules if not asked.only or module.stem in asked.only]
    sample = [(module, *place) for module in modules for place in places(module.read_text())]
    random.Random(asked.seed).shuffle(sample)
    noticed = 0
    for module, at, which in sample[: asked.count]:
        text, line, said = with_fault(module.read_text(), at, which)
        reach = set(measured.contexts_by_lineno(str(module.resolve())).get(line, [])) - {""}
        tests, spent = [], 0.0
        for test in sorted(reach, key=lambda name: took.get(name, 0.0)):
            spent += took.get(test, 0.0)
            tests += [test] if spent <= asked.seconds or not tests else []
        (copied.parent / module).write_text(text)
        if tests and not passes(tests, copied, 60 + 4 * asked.seconds):
            noticed += 1
        else:
            print(f"{module}:{line}: {said}: {len(tests)} of {len(reach)} tests pass", flush=True)
        (copied.parent / module).write_text(module.read_text())
    print(f"{noticed} of {min(asked.count, len(sample))} noticed, of {len(sample)} that there are")


if __name__ == "__main__":
    main()
