"""Cost of the elimination: `python -m benchmarks.placement [--quick]`.

Side by side on the same pools: algorithm 2 to the letter (SciPy's Riccati solver with one column a gauge, every candidate
at every step), the same with the gauges compressed to as many rows as states, and this package. Then the package alone
against the number of states and of scenarios. The pools lie on the faces of a steel cantilever that bends about both axes
and twists, at seeded random places and angles; the unknowns are a tip load and Young's modulus (the modulus alone against
the number of states). The peers run in full where that takes minutes at most; elsewhere some steps are timed and the sum
over all steps is taken from a power law through them, which is said. Every line is measured in a process of its own, with
one BLAS thread unless OPENBLAS_NUM_THREADS says otherwise: the matrices are small. Machines differ and are shared: read the
load beside the times.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

E0, RHO, NU, LENGTH, WIDTH, HEIGHT = 2.0e11, 7850.0, 0.3, 2.0, 0.10, 0.20
KEEP, NOISE, STEP, RATIO = 4, 1e-6, 5e-4, 0.01


def bending(count: int) -> tuple[np.ndarray, np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Cantilever in bending: β (count,) [1/m], tip value of φ, and x → φ'' (m, count), with ∫φ² = LENGTH."""
    root = (np.arange(1, count + 1) - 0.5) * np.pi
    for _ in range(20):
        root -= (np.cos(root) + 1 / np.cosh(root)) / (-np.sin(root) - np.tanh(root) / np.cosh(root))
    beta = root / LENGTH
    # 1 − σ without the difference of two growing functions
    rest = (np.sin(root) - np.cos(root) - np.exp(-root)) / (np.sinh(root) + np.sin(root))

    def curvature(x: np.ndarray) -> np.ndarray:
        s = np.outer(x, beta)
        return beta**2 * (np.exp(-s) + np.cos(s) - (1 - rest) * np.sin(s) + rest * np.sinh(s))

    return beta, 2.0 * (-1.0) ** np.arange(count), curvature


def make_scenarios(pool: int, modes: int, inputs: tuple[str, ...], count: int, seed: int = 0) -> tuple[Any, ...]:
    """`count` linearisation instants of the beam with `pool` gauges and its lowest `modes`."""
    from tests.placement.whole_pools import augment_rows, whole_pool_weight

    from strainsight.fem.affine import AffineOperator
    from strainsight.loads.input_models import Unknowns
    from strainsight.loads.linearisation import gauge_intensity, linearise, process_intensity
    from strainsight.placement.scenario import Scenario
    from strainsight.rom.model import Damping, ReducedModel

    area = WIDTH * HEIGHT
    beta, tip, curvature = bending(modes)
    twist = (np.arange(1, modes + 1) - 0.5) * np.pi / LENGTH
    # torsion constant of a rectangle of sides 1 : 2
    polar, torsion = area * (WIDTH**2 + HEIGHT**2) / 12, 0.229 * HEIGHT * WIDTH**3
    mass = RHO * area * LENGTH
    omega = np.concatenate(
        [
            beta**2 * np.sqrt(E0 * HEIGHT**2 / 12 / RHO),
            beta**2 * np.sqrt(E0 * WIDTH**2 / 12 / RHO),
            twist * np.sqrt(E0 / (2 * (1 + NU)) * torsion / (RHO * polar)),
        ]
    )
    rng = np.random.default_rng(seed)
    x, across = rng.uniform(0.02, 0.97, pool) * LENGTH, rng.uniform(-0.95, 0.95, pool)
    angle, side, flank = rng.uniform(0, np.pi, pool), rng.choice([-1.0, 1.0], pool), rng.random(pool) < 0.4
    y = np.where(flank, side, across) * WIDTH / 2
    z = np.where(flank, across, side) * HEIGHT / 2
    bend, turn = curvature(x) / np.sqrt(mass), twist * np.cos(np.outer(x, twist)) * np.sqrt(2 / (RHO * polar * LENGTH))
    along, shear = np.cos(angle) ** 2 - NU * np.sin(angle) ** 2, np.sin(angle) * np.cos(angle)
    rows = np.hstack(
        [
            -(z * along)[:, None] * bend,
            -(y * along)[:, None] * bend,
            (0.9 * WIDTH * side * (1 - across**2) * shear)[:, None] * turn,
        ]
    )
    # Fz stands 20 mm off the axis, Fy on it
    swing = np.sqrt(2 / (RHO * polar * LENGTH)) * (-1.0) ** np.arange(modes)
    S = np.zeros((3 * modes, 2))
    S[:modes, 0], S[modes : 2 * modes, 1] = tip / np.sqrt(mass), tip / np.sqrt(mass)
    S[2 * modes :, 0] = 0.02 * swing
    lowest = np.argsort(omega)[:modes]
    omega, rows, S = omega[lowest], rows[:, lowest], S[lowest]
    model = ReducedModel(
        mass=AffineOperator(np.zeros((modes, modes)), {"rho": np.eye(modes) / RHO}),
        stiffness=AffineOperator(np.zeros((modes, modes)), {"E": np.diag(omega**2) / E0}),
        input_shape=S,
        inputs=("Fz", "Fy"),
        reference={"E": E0, "rho": RHO},
        damping=Damping("modal", ratio=RATIO),
    )
    t = np.linspace(0, 1, 2001)
    state, drive = np.zeros((len(t), 2 * modes)), 2 * np.pi * np.array([20.0, 40.0])
    for j, force in enumerate((1e4, 1e3)):
        gain = S[:, j] * force / (omega**2 - drive[j] ** 2 + 2j * RATIO * drive[j] * omega)
        wave = gain * np.exp(1j * drive[j] * t)[:, None]
        state += np.hstack([wave.imag, (1j * drive[j] * wave).imag])
    u = np.column_stack([1e4 * np.sin(drive[0] * t), 1e3 * np.sin(drive[1] * t)])
    unknowns = Unknowns(inputs, ("E",), {"Fz": 1e4, "Fy": 1e3}, {"E": E0, "rho": RHO})
    at = 63 + 97 * np.arange(count)
    F = linearise(model, unknowns, {"E": E0, "rho": RHO}, state[at], u[at])
    Q = process_intensity(modes, unknowns, {"Fz": 20.0, "Fy": 40.0}, {"E": 0.05})
    H, r = augment_rows(rows, unknowns), gauge_intensity(np.full(pool, NOISE), STEP)
    weight = whole_pool_weight(
        [Scenario(f, Q, H, r, np.zeros(len(Q))) for f in F], len(Q) - np.arange(unknowns.count, 0, -1)
    )
    return tuple(Scenario(f, Q, H, r, weight) for f in F)


def in_blocks(scenario: Any, channels: int) -> Any:
    """Its gauges by threes, as rosettes: rows of the same noise that are placed as one."""
    from strainsight.placement.scenario import Scenario

    H = scenario.H.reshape(-1, channels, scenario.H.shape[1])
    return Scenario(scenario.F, scenario.Q, H, scenario.r.reshape(-1, channels), scenario.weight)


def make_limits(pool: int, kind: str) -> Any:
    """A count; or with it no two within 80 mm of each other; or prices of 0.5 to 3 and a budget of 5."""
    from scipy.spatial import KDTree

    from strainsight.placement.limits import limits_of

    rng = np.random.default_rng(1)
    place, price = rng.uniform(0, 1, (pool, 2)) * [LENGTH, WIDTH], np.round(rng.uniform(0.5, 3, pool), 2)
    if kind == "spacing":
        return limits_of(pool, KEEP, near=KDTree(place).query_pairs(0.08, output_type="ndarray"))
    return limits_of(pool, KEEP, price=price, budget=5.0) if kind == "budget" else limits_of(pool, KEEP)


def peer_cost(scenario: Any, gauges: np.ndarray, compress: bool) -> float:
    """tr(W P) of a set by SciPy's solver; infinite where it gives up."""
    from scipy.linalg import LinAlgError, solve_continuous_are

    rows = scenario.rows[gauges].reshape(-1, len(scenario.F))
    if compress and len(rows) > rows.shape[1]:
        rows = np.linalg.qr(rows, mode="r")
    try:
        P = solve_continuous_are(scenario.F.T, rows.T, scenario.Q, np.eye(len(rows)))
    except LinAlgError:
        return np.inf
    return float(scenario.weight @ np.diag(P))


def peer_in_full(scenario: Any, compress: bool) -> list[int]:
    """Algorithm 2: every candidate at every step. The gauges in the order of their removal."""
    left = np.arange(len(scenario.H))
    removed = []
    while len(left) > KEEP:
        costs = [peer_cost(scenario, np.delete(left, i), compress) for i in range(len(left))]
        out = int(np.argmin(costs))
        removed.append(int(left[out]))
        left = np.delete(left, out)
    return removed


def peer_by_samples(scenario: Any, compress: bool, seconds: float) -> tuple[float, int]:
    """Seconds of all steps from a power law through solves with 4, 8, 16, … gauges, and the largest that was timed."""
    total = len(scenario.H)
    sizes, times = [], []
    size, start = KEEP, time.perf_counter()
    while True:
        chosen = np.linspace(0, total - 1, size).astype(int)
        spent = []
        for _ in range(3 if time.perf_counter() - start < 0.2 * seconds else 1):
            begin = time.perf_counter()
            peer_cost(scenario, chosen, compress)
            spent.append(time.perf_counter() - begin)
        sizes.append(size)
        times.append(min(spent))
        # the next one costs up to eight times as much
        if size >= total - 1 or time.perf_counter() - start + 8 * times[-1] > seconds:
            break
        size = min(2 * size, total - 1)
    steps = np.arange(total, KEEP, -1)
    slope = np.polyfit(np.log(sizes[-2:]), np.log(times[-2:]), 1)[0]
    each = np.interp(np.log(steps - 1), np.log(sizes), times)
    beyond = steps - 1 > sizes[-1]
    # no more than the cube that a dense solver tends to
    each[beyond] = times[-1] * ((steps[beyond] - 1) / sizes[-1]) ** np.clip(slope, 0.0, 3.0)
    return float(np.sum(steps * each)), size


def measure(job: dict[str, Any]) -> dict[str, Any]:
    """One line of a table, in this process."""
    from tests.placement.whole_pools import eliminate

    from strainsight.placement.exchange import exchange
    from strainsight.placement.scenario import solve_pool

    before = peak_mebibytes()
    scenarios = make_scenarios(job["pool"] * job["channels"], job["modes"], tuple(job["inputs"]), job["scenarios"])
    if job["channels"] > 1:
        scenarios = tuple(in_blocks(s, job["channels"]) for s in scenarios)
    limits = make_limits(job["pool"], job["limits"])
    found: dict[str, Any] = {"states": len(scenarios[0].F), "load": os.getloadavg()[0]}
    if job["peer"] is None:
        start = time.perf_counter()
        result = eliminate(scenarios, limits)
        found["seconds"] = time.perf_counter() - start
        found["solves"] = float(result.solves.sum() / len(result.solves) / len(scenarios))
        found["residual"], found["removed"] = result.residual, result.removed.tolist()
        found["rise"] = float(result.rise[0])
        start = time.perf_counter()
        swapped = exchange(result.pools, result.selected, limits=limits)
        found["exchange"], found["complete"] = time.perf_counter() - start, swapped.complete
    else:
        # in the package's coordinates, where SciPy's solver does best
        scenario = solve_pool(scenarios[0]).scenario
        compress = job["peer"] == "compressed"
        if job["full"]:
            start = time.perf_counter()
            found["removed"] = peer_in_full(scenario, compress)
            found["seconds"] = time.perf_counter() - start
        else:
            found["seconds"], found["timed"] = peer_by_samples(scenario, compress, job["budget"])
        found["solves"] = (job["pool"] + KEEP + 1) / 2
    found["peak"] = peak_mebibytes() - before
    return found


def peak_mebibytes() -> float:
    """Largest memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(**job: Any) -> dict[str, Any]:
    """`measure` in a process of its own."""
    single = {name: os.environ.get(name, "1") for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")}
    job = {"modes": 10, "inputs": ("Fz",), "scenarios": 1, "peer": None, "full": False, "budget": 20.0} | job
    job = {"channels": 1, "limits": "count"} | job
    done = subprocess.run(
        [sys.executable, "-W", "ignore", __file__, "--measure", json.dumps(job)],
        capture_output=True,
        text=True,
        env=os.environ | single,
    )
    if done.returncode:
        raise SystemExit(f"{job}:\n{done.stderr}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def number(value: float) -> str:
    return f"{value:12.2f}" if value < 1e8 else f"{value:12.1e}"


def line(what: str, pool: int, scenarios: int, found: dict[str, Any], note: str = "") -> None:
    exchange = f"{found['exchange']:9.2f}" if "exchange" in found else f"{'':9s}"
    print(
        f"{what:12s} {pool:6d} {found['states']:6d} {scenarios:9d} {found['solves']:10.2f} {number(found['seconds'])} "
        f"{number(1e3 * found['seconds'] / (pool - KEEP))} {exchange} {found['peak']:9.1f} {found['load']:5.1f}  {note}",
        flush=True,
    )


def agreement(ours: list[int], theirs: list[int]) -> str:
    same = next((i for i, (a, b) in enumerate(zip(ours, theirs, strict=True)) if a != b), len(ours))
    kept = "the same gauges kept" if set(ours) == set(theirs) else "other gauges kept"
    return f"first {same} of {len(ours)} removals in the order of this package, {kept}"


def exponent(sizes: list[int], results: list[dict[str, Any]], key: str) -> float:
    values = [max(r[key], 1e-9) for r in results]
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def main(quick: bool) -> None:
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; eliminations down to {KEEP} gauges")
    header = (
        f"{'':12s} {'pool':>6s} {'states':>6s} {'scenarios':>9s} {'solves/rem':>10s} {'seconds':>12s} {'ms/removal':>12s} "
        f"{'exchange':>9s} {'MiB':>9s} {'load':>5s}"
    )
    print(f"\nagainst the size of the pool\n{header}")
    sizes = [100, 1000] if quick else [100, 1000, 5000, 20_000]
    results = []
    for pool in sizes:
        ours = run(pool=pool)
        results.append(ours)
        line("this package", pool, 1, ours, f"residual {ours['residual']:.0e}, first rise {ours['rise']:.1e}")
        for peer in ("compressed", "literal"):
            full = pool == 100 and not quick
            theirs = run(pool=pool, peer=peer, full=full, budget=5.0 if quick else 40.0)
            note = f"{theirs['seconds'] / ours['seconds']:.3g} times as long"
            if full:
                note += f"; {agreement(ours['removed'], theirs['removed'])}"
            else:
                note += f"; extrapolated from solves with up to {theirs['timed']} gauges"
            line(peer, pool, 1, theirs, note)
    print(
        f"this package: seconds ~ pool^{exponent(sizes, results, 'seconds'):.2f}; MiB: over the imports, the making of the "
        "pool among it"
    )
    print(f"\nagainst the number of states\n{header}")
    modes = [10, 20] if quick else [10, 20, 40, 65]
    states = []
    for count in modes:
        states.append(run(pool=100, modes=count, inputs=()))
        line("this package", 100, 1, states[-1], f"residual {states[-1]['residual']:.0e}")
        theirs = run(pool=100, modes=count, inputs=(), peer="compressed", budget=5.0)
        line(
            "compressed", 100, 1, theirs, f"{theirs['seconds'] / states[-1]['seconds']:.0f} times as long; extrapolated"
        )
    print(f"this package: seconds ~ states^{exponent([2 * m + 1 for m in modes], states, 'seconds'):.2f}")
    pool = 100 if quick else 1000
    print(f"\nagainst the number of scenarios\n{header}")
    single: float | None = None
    for count in (1, 5) if quick else (1, 5, 20):
        found = run(pool=pool, scenarios=count)
        single = single or found["seconds"]
        line("this package", pool, count, found, f"{found['seconds'] / single:.1f} times one scenario")
    print(f"\nagainst the limits and the channels\n{header}")
    single = None
    for what, more in (
        ("count", {}),
        ("spacing", {"limits": "spacing"}),
        ("budget", {"limits": "budget"}),
        ("rosettes", {"channels": 3}),
    ):
        found = run(pool=pool, **more)
        single = single or found["seconds"]
        line(what, pool, 1, found, f"{found['seconds'] / single:.1f} times a count of single gauges")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small pools only, peers from samples")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.measure:
        print(json.dumps(measure(json.loads(chosen.measure))))
    else:
        main(chosen.quick)
