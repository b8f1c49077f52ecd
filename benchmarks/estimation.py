"""What the filter reaches on the cantilever: `python -m benchmarks.estimation [inputs|cases|sets]`, all three by default.

inputs  every model of an unknown load, 20 Hz force, 1 % noise: filtered and smoothed error beside the claimed σ
cases   single unknowns and joint ones that can be distinguished, three truths, three noise levels: error beside σ
sets    the chosen layout among 200 random ones: rank by real and by claimed error, and how the two go together

Numbers are errors, not times: they do not depend on the machine. Each row is a run of the command line.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from strainsight.runner.artefact import Artefact

ROOT = Path(__file__).resolve().parent.parent
COMMAND = [str(Path(sys.executable).parent / "strainsight")]
E = {"property": "youngs_modulus", "region": 1, "guess": 1.89e11, "range": [1.6e11, 2.4e11]}
RHO = {"property": "density", "region": 1, "guess": 7065.0, "range": [6000.0, 9500.0]}
TRUE = {"E": 2.1e11, "rho": 7850.0}
Config = dict[str, Any]


def load(frequency: float, amplitude: float, known: bool, direction: tuple[int, int, int] = (0, 0, 1)) -> Config:
    """A sine at the tip."""
    signal = {"type": "sine", "frequency": frequency, "amplitude": amplitude}
    return {"node": 2, "direction": list(direction), "known": known, "signal": signal}


def config(name: str, parameters: Config, loads: Config, step: float, **changes: Any) -> Config:
    """A placement for all parameters and unknown loads, and its validation."""
    estimate = [n for n, entry in loads.items() if not entry["known"]] + list(parameters)
    return {
        "kind": "placement",
        "name": name,
        "seed": 1,
        "mesh": {"file": str(ROOT / "meshes" / "cantilever.bdf")},
        "parameters": parameters,
        "loads": loads,
        "damping": {"type": "modal", "ratio": 0.01},
        "train": {"duration": 1.0, "time_step": step},
        "gauges": {
            "direction": {"type": "axis", "axis": [1, 0, 0]},
            "noise_std": {"relative_to_strongest": 0.01},
        },
        "screen": {"keep": 100, "minimum_spacing": 0.02},
        "place": {"estimate": estimate, "keep": 4, "instants": 5},
        "validate": {
            "truth": {"model": "modes", "parameters": {n: TRUE[n] for n in parameters}},
            "time_step": step,
            "duration": 1.0,
            "initial_std": dict.fromkeys(estimate, 0.1),
            "random_sets": 0,
            "noise_factors": [0.1, 5.0],
            "repeats": 1,
        },
    } | changes


def validated(settings: Config, folder: Path, *overrides: str) -> Artefact:
    """validate.h5 of a run."""
    path = folder / f"{settings['name']}.yaml"
    path.write_text(json.dumps(settings))  # JSON is YAML
    words = [word for text in overrides for word in ("--set", text)]
    done = subprocess.run(
        [*COMMAND, "validate", str(path), "--results", str(folder / "results"), *words], capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(done.stderr or done.stdout)
    return Artefact(folder / "results" / settings["name"] / "validate.h5")


def percent(value: float) -> str:
    return f"{100 * value:8.3g} %"


def inputs(folder: Path) -> None:
    print("An unknown force of 20 Hz, first mode 40 Hz, noise 1 %, truth modes")
    print(f"{'model':30s} {'step':>9s} {'filtered':>10s} {'claimed':>10s} {'smoothed':>10s} {'claimed':>10s}")
    for step in (1e-3, 2.5e-4):
        settings = config(f"input-{round(1e6 * step)}us", {}, {"tip": load(20.0, 1e4, False)}, step)
        for model in ("random_walk", "integrated_random_walk", "matern", "oscillator"):
            extra = ", smoothness: 5/2" if model == "matern" else ""
            change = (
                f"loads.tip.process_noise={{model: {model}, frequency: {10.0 if model == 'matern' else 20.0}{extra}}}"
            )
            s = validated(settings, folder, change).summary
            row = (s["error.tip"], s["std.tip"], s["smoothed.tip"], s["smoothed_std.tip"])
            print(f"{model:30s} {step:7.2g} s {' '.join(percent(float(x)) for x in row)}")


def cases(folder: Path) -> None:
    near, slow = load(35.0, 1e3, True), load(20.0, 1e4, True)
    runs = {
        "E": config("E", {"E": E}, {"tip": slow}, 5e-4),
        "rho": config("rho", {"rho": RHO}, {"tip": load(35.0, 1e4, True)}, 5e-4),
        "input": config("input", {}, {"tip": load(20.0, 1e4, False)}, 2.5e-4),
        "E+rho": config("E-rho", {"E": E, "rho": RHO}, {"tip": slow, "shaker": near}, 5e-4),
        "input+E": config("input-E", {"E": E}, {"tip": load(2.0, 1e4, False), "shaker": near}, 5e-4),
    }
    print("\nError, and 2σ as claimed, at 0.1, 1 and 5 % of noise; of loads smoothed σ is not in the studies: filtered")
    print(f"{'case':10s} {'truth':6s} {'unknown':8s} {'0.1 %':>24s} {'1 %':>24s} {'5 %':>24s}")
    for case, settings in runs.items():
        for entry in settings["loads"].values():
            if not entry["known"]:
                entry["process_noise"] = {"model": "integrated_random_walk"}
        for truth in ("full", "modes", "perturbed"):
            found = validated(settings, folder, f"validate.truth.model={truth}")
            for name in settings["place"]["estimate"]:
                s = found.summary
                error = [found[f"/noise/error/{name}"][0], s[f"error.{name}"], found[f"/noise/error/{name}"][1]]
                std = [found[f"/noise/std/{name}"][0], s[f"std.{name}"], found[f"/noise/std/{name}"][1]]
                cells = (f"{percent(float(e))} ± {percent(2 * float(d))}" for e, d in zip(error, std, strict=True))
                print(f"{case:10s} {truth:6s} {name:8s} {' '.join(f'{cell:>24s}' for cell in cells)}", flush=True)


def sets(folder: Path) -> None:
    print("\nThe chosen layout among 200 random ones of all candidates (1 is best of 201), truth perturbed")
    runs = {
        "E": config("sets-E", {"E": E}, {"tip": load(20.0, 1e4, True)}, 5e-4),
        "input": config("sets-input", {}, {"tip": load(20.0, 1e4, False)}, 2.5e-4),
    }
    print(f"{'case':10s} {'chosen from':12s} {'rank, real':>12s} {'rank, claimed':>14s} {'correlation':>12s}")
    for case, settings in runs.items():
        settings["validate"] |= {"random_sets": 200, "truth": settings["validate"]["truth"] | {"model": "perturbed"}}
        for pool, keep in (("100 screened", "100"), ("all 608", "all")):
            s = validated(settings, folder, f"screen={{keep: {keep}}}").summary
            for name in settings["place"]["estimate"]:
                real, claimed = s[f"rank_real.{name}"], s[f"rank_claimed.{name}"]
                print(
                    f"{case:10s} {pool:12s} {real:12d} {claimed:14d} {float(s[f'rank_correlation.{name}']):12.2f}",
                    flush=True,
                )


def main() -> None:
    asked = sys.argv[1:] or ["inputs", "cases", "sets"]
    with tempfile.TemporaryDirectory() as folder:
        for name in asked:
            {"inputs": inputs, "cases": cases, "sets": sets}[name](Path(folder))


if __name__ == "__main__":
    main()
