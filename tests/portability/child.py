"""`python child.py PLAN`: every stage but the pages of some configs, in a process of its own.

PLAN is JSON: results, a folder; runs, pairs of a config and its overrides, those before others that take a guess from them;
superlu, whether SuperLU solves instead of PARDISO; compatible, whether MKL takes its code for any processor. The environment
says on which processor, linear algebra and threads. NumPy is loaded first, so that the product cannot hold it to one thread.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401

from strainsight.config.load import load_config
from strainsight.fem import factorisation
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.placement import PLACEMENT

MKL_CBWR_COMPATIBLE = 3
PAGES = ("report", "test")
"""Stages that compute nothing: their files hold words and pictures of what the others found."""


def run_all(results: Path, runs: Iterable[tuple[str, Sequence[str]]]) -> None:
    """The artefacts of every config in results/<its name>."""
    for config, overrides in runs:
        loaded = load_config(Path(config), overrides)
        job = Job(loaded.data, Path(config).parent, results, loaded.locate, loaded.model)
        stages = PLACEMENT if loaded.data["kind"] == "placement" else bench_stages(loaded.data)
        for _ in run([stage for stage in stages if stage.name not in PAGES], job):
            pass


if __name__ == "__main__":
    plan = json.loads(sys.argv[1])
    if plan["superlu"]:
        sys.modules["pypardiso"] = None  # type: ignore[assignment]
        warnings.filterwarnings("ignore", message="the equation solver PARDISO is not available")
    if plan["compatible"]:  # the product sets the branch itself, over what MKL_CBWR says
        factorisation._MKL_CBWR_AVX2 = factorisation._MKL_CBWR_AUTO = MKL_CBWR_COMPATIBLE
    run_all(Path(plan["results"]), plan["runs"])
