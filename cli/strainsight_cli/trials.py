"""What doctor tries in a process of its own, since it may take the process down: imports, the solver, a picture."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from strainsight.imports import FOLDER
from strainsight.processes import inherited

SECONDS = 120.0
"""[s] after which a trial is given up."""
SIDE = 20
"""Nodes along an edge of the grid that the solver is tried on."""


def tried(name: str, words: Sequence[str] = (), seconds: float = SECONDS) -> tuple[dict[str, Any], str]:
    """Run the trial of that name in a new process: what it found so far, and what ended it early, "" if nothing did."""
    # a numpy.py in the user's folder is not the numpy that is asked about
    code = "import sys; from strainsight_cli.trials import main; main(sys.argv[1:])"
    command = [sys.executable, "-P", "-c", code, name, *words]
    try:
        done = subprocess.run(
            command, env=inherited(), cwd=FOLDER, capture_output=True, text=True, errors="replace", timeout=seconds
        )
    except subprocess.TimeoutExpired as late:
        text = late.stdout or b""
        return _found(text.decode(errors="replace") if isinstance(text, bytes) else text), f"no end after {seconds:g} s"
    if done.returncode < 0:
        return _found(done.stdout), f"crashed with {_signal(-done.returncode)}"
    last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    return _found(done.stdout), last[0] if done.returncode else ""


def _found(text: str) -> dict[str, Any]:
    """The facts among the lines; libraries print what they like beside them."""
    facts: dict[str, Any] = {}
    for line in text.splitlines():
        if line.startswith(MARK):
            facts |= json.loads(line[len(MARK) :])
    return facts


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


MARK = "strainsight trial "


def _say(**facts: Any) -> None:
    print(f"\n{MARK}{json.dumps(facts)}", flush=True)


def imports(modules: Sequence[str]) -> None:
    """Import each; says before which one it is at, so that a crash has a name."""
    import importlib

    failed: dict[str, str] = {}
    for module in modules:
        _say(at=module)
        try:
            importlib.import_module(module)
        except Exception as error:  # whatever a broken package raises
            failed[module] = f"{type(error).__name__}: {error}"
            _say(failed=failed)
    _say(at="")


def solver() -> None:
    """Factorise and solve a small Laplacian by the solver that the pipeline would take."""
    import warnings

    import numpy as np
    from scipy import sparse

    from strainsight.fem.factorisation import factorise, name_mkl

    try:
        import pypardiso

        name_mkl()
        pypardiso.PyPardisoSolver()
    except Exception as error:  # a missing library, of whatever kind
        _say(why=f"{type(error).__name__}: {error}".splitlines()[0])
    line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(SIDE, SIDE))
    one = sparse.eye_array(SIDE)
    grid = sparse.kron(sparse.kron(line, one), one) + sparse.kron(sparse.kron(one, line), one)
    A = sparse.csr_array(grid + sparse.kron(sparse.kron(one, one), line))
    x = np.cos(np.arange(A.shape[0], dtype=float))
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        factor = factorise(A)
    off = float(np.abs(factor.solve(A @ x) - x).max())
    _say(solver=factor.solver, unknowns=factor.size, error=off, seconds=time.perf_counter() - start)


def rendering() -> None:
    """Draw one sphere off screen, as the report does."""
    import numpy as np
    import pyvista as pv

    start = time.perf_counter()
    plotter: Any = pv.Plotter(off_screen=True, window_size=[160, 120])
    plotter.set_background("white")
    plotter.add_mesh(pv.Sphere(), color="red")
    picture = np.asarray(plotter.screenshot(None, return_img=True))
    middle, corner = (tuple(int(c) for c in picture[at][:3]) for at in ((60, 80), (0, 0)))
    plotter.close()
    _say(middle=middle, corner=corner, seconds=time.perf_counter() - start)


def main(words: Sequence[str]) -> None:
    """The trial named first."""
    name, *others = words
    if name == "imports":
        imports(others)
    else:
        {"solver": solver, "rendering": rendering}[name]()
