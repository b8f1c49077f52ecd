"""Cost of the grid filter: `python -m benchmarks.grid_filter [--quick]`.

The cantilever of `filter.py`, 11 modes with four strain gauges and an unknown tip load, 23 states, and three unknown moduli,
those of its thirds. 10 000 samples of the model itself, moduli from a prior of 5 %. Prints the time on one core and on two, how
often the lattice was laid, its points at the end, and the real errors over σ; then the same with 26 constants that σ holds
beside the states. The grid filter is of no use if it is slow: 60 s on two cores is the limit.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from benchmarks.filter import E0, HEIGHT, LENGTH, MODES, WIDTH, cantilever
from tests.estimation.truth import draw_truth

from strainsight.estimation.conditional import ConsideredParameters, none_considered
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import GridRecord
from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.runner.sweep_location import Where, opened

THIRDS = ("E1", "E2", "E3")
CONSTANTS = 26


def in_thirds() -> FilterModel:
    """The model with a modulus for every third of the length: K = Σ Eᵢ I ∫ φ″φ″ᵀ over it."""
    model = cantilever()
    own, terms = model.model, {}
    x = (np.arange(3000) + 0.5) / 3000 * LENGTH
    curved = curvatures(x)
    for i, name in enumerate(THIRDS):
        part = slice(1000 * i, 1000 * (i + 1))
        terms[name] = WIDTH * HEIGHT**3 / 12 * (curved[part].T @ curved[part]) * LENGTH / 3000
    rho = own.reference["rho"]
    reference = dict.fromkeys(THIRDS, E0) | {"rho": rho}
    # of unit modal mass at the reference
    mass = rho * WIDTH * HEIGHT * LENGTH
    split = replace(
        own,
        stiffness=AffineOperator(np.zeros((MODES, MODES)), {k: v / mass for k, v in terms.items()}),
        reference=reference,
    )
    unknowns = Unknowns(("tip",), THIRDS, {"tip": 1e4}, reference)
    H = np.hstack([model.H, np.zeros((4, 3))])
    Q = np.pad(model.Q, (0, 3))
    return replace(model, model=split, unknowns=unknowns, H=H, Q=Q, fixed={"rho": rho})


def curvatures(x: np.ndarray) -> np.ndarray:
    """φ″ (any, MODES) of the modes of a clamped-free beam, φ of amplitude 2 at the tip."""
    root = (np.arange(1, MODES + 1) - 0.5) * np.pi
    for _ in range(20):
        root -= (np.cos(root) + 1 / np.cosh(root)) / (-np.sin(root) - np.tanh(root) / np.cosh(root))
    beta = root / LENGTH
    rest = (np.sin(root) - np.cos(root) - np.exp(-root)) / (np.sinh(root) + np.sin(root))
    s = np.outer(x, beta)
    return np.asarray(beta**2 * (np.exp(-s) + np.cos(s) - (1 - rest) * np.sin(s) + rest * np.sinh(s)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="1000 samples")
    steps = 1000 if parser.parse_args().quick else 10_000
    model = in_thirds()
    P = np.diag([1e-9] * (2 * MODES) + [1.0] + [0.05**2] * 3)
    known = np.zeros((steps, 3, 0))
    truth, y = draw_truth(model, np.zeros(model.size), P, known, [1])
    states = model.parameter_states.start
    rng = np.random.default_rng(2)
    D = 0.01 * rng.standard_normal((CONSTANTS, 4, 1)) * model.H[:, :states]
    constants = ConsideredParameters(("gain",) * CONSTANTS, D, np.zeros((CONSTANTS, 4, 0)), np.zeros((CONSTANTS, 4)))
    print(f"{steps} samples, {states} states, 3 parameters")
    for words, considered in (("nothing beside", none_considered(model)), (f"{CONSTANTS} constants beside", constants)):
        for threads in (1, 2):
            start = time.perf_counter()
            with opened(Where(jobs=threads)):
                found = filter_on_grid(GridRecord(model, np.zeros(model.size), P, known, y[:, 0], considered))
            took = time.perf_counter() - start
            error = found.run.mean[-1, 0, states:] - truth[-1, 0, states:]
            shares = ", ".join(f"{e:.2f}" for e in error / found.run.std[-1, 0, states:])
            print(
                f"{words}, {threads} threads: {took:.1f} s, laid {found.grid_count} times, {len(found.weight)} points, "
                f"error/σ {shares}",
                flush=True,
            )


if __name__ == "__main__":
    main()
