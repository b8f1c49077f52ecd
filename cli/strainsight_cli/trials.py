"""Trials of doctor in a separate process, since they may crash it: imports, the solver, a picture."""

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
"""[s] Time limit of a trial."""
SIDE = 20
"""Number of nodes along an edge of the grid of the solver trial."""


def tried(name: str, words: Sequence[str] = (), seconds: float = SECONDS) -> tuple[dict[str, Any], str]:
    """Run the named trial in a new process: its results, and the reason for an early end ("" if none)."""
    # a numpy.py in the user's folder is not the numpy that is asked about
    code = "import sys; from strainsight_cli.trials import main; main(sys.argv[1:])"
    command = [sys.executable, "-P", "-c", code, name, *words]
    try:
        done = subprocess.run(
            command, env=inherited(), cwd=FOLDER, capture_output=True, text=True, errors="replace", timeout=seconds
        )
    except subprocess.TimeoutExpired as late:
        text = late.stdout or b""
        return _results(
            text.decode(errors="replace") if isinstance(text, bytes) else text
        ), f"the check has no result after {seconds:g} s"
    if done.returncode < 0:
        return _results(done.stdout), f"crashed with {_signal(-done.returncode)}"
    last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    return _results(done.stdout), last[0] if done.returncode else ""


def _results(text: str) -> dict[str, Any]:
    """Results among the printed lines; libraries may print other lines."""
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
    """Import each module; its name is printed before, so that a crash can be assigned."""
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
    """Factorise and solve a small Laplacian with the solver of the pipeline."""
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
    """Render one sphere off screen, as for the results page."""
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
    """Run the trial named first."""
    name, *others = words
    if name == "imports":
        imports(others)
    else:
        {"solver": solver, "rendering": rendering}[name]()
