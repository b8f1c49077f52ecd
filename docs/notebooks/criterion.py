# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Choose a criterion, or write your own
#
# With two unknown forces there is more than one meaning of a good layout. This notebook compares the three criteria of
# `place.criterion` on the cantilever and then adds a criterion of its own.

# %%
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

from strainsight import api

CONFIG = "../examples/test.yaml"
SIDE = "{node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 10.0, amplitude: 1.0e+3}}"
OPTIONS = [
    f"loads.side={SIDE}", "place.estimate=[tip, side]", "validate.initial_std={tip: 1, side: 1}",
    "gauges.fixed_file=null", "place.keep=3", "place.instants=1",
]  # fmt: skip
case = api.load(CONFIG, OPTIONS)
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)

# %% [markdown]
# The trace adds the variances. The determinant is the area of the error ellipse. The worst eigenvalue is its longest axis.

# %%
layouts = {}
for criterion in ("trace", "log_determinant", "worst_eigenvalue"):
    case = api.load(CONFIG, [*OPTIONS, f"place.criterion={criterion}"])
    layouts[criterion] = api.place(case, mesh, reduced, training, screened)
    std = layouts[criterion].expected.std
    print(f"{criterion}: σ of the vertical force {100 * std['tip']:.3g} %, of the lateral force {100 * std['side']:.3g} %")

# %% [markdown]
# The elimination visits every number of gauges from the pool to three. Halving the metric divides σ by √2. Where the
# curve is flat, another gauge only averages noise.

# %%
metric = layouts["trace"].elimination.cost
count = case.config.place.keep + np.arange(len(metric))[::-1]
for k in (3, 4, 6, 8, 16, 32):
    print(f"{k} gauges: tr(W P) = {metric[count == k][0]:.3g}")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(count, metric)
axes.set(xlabel="number of gauges", ylabel="tr(W P)", xscale="log", yscale="log");

# %% [markdown]
# ## A criterion of your own
#
# A criterion c(M) of the covariance M of the unknowns has to be a variance: positive, c(αM) = α c(M), not decreasing in M,
# and 1/c concave in M⁻¹. Then elimination, exchanges and lower bound hold for it. This one is the Frobenius norm
# c = (tr M²)^½, between the trace and the worst eigenvalue. Its gradient is M/c, and its increase is computed from the
# increment, not from a difference of two nearly equal numbers.


# %%
@dataclass(frozen=True)
class FrobeniusNorm(api.Criterion):
    name = "frobenius"
    title = "Frobenius norm"
    symbol = "‖P‖"
    sigma = "the root of the Frobenius norm of the covariance"
    meaning = "root of the sum of the squared variances along the axes of the error ellipsoid"

    def value(self, M):
        return float(np.linalg.norm(M))

    def gradient(self, M):
        return M / np.linalg.norm(M)

    def rise(self, M, D):
        return float(np.sum(D * (2 * M + D)) / (np.linalg.norm(M + D) + np.linalg.norm(M)))


# %% [markdown]
# Three forces on a simply supported beam, given by its modes:

# %%
x = np.linspace(0, 1, 41)
modes = np.sin(np.outer(x, np.pi * np.arange(1, 6)))
strain_operator = -0.004 * np.gradient(np.gradient(np.eye(41), x, axis=0), x, axis=0)[4:-4]
loads = np.zeros((41, 3))
loads[[8, 20, 30], range(3)] = 1.0
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for row, criterion in enumerate(("trace", "log_determinant", "worst_eigenvalue", FrobeniusNorm())):
    placement = api.place_modes(
        modes, [11.1, 44.4, 100.0, 177.8, 277.8], 0.02, strain_operator,
        keep=4, loads=loads, amplitude=20.0, noise=1e-6, criterion=criterion,
    )  # fmt: skip
    name = criterion if isinstance(criterion, str) else criterion.name
    print(f"{name:16} σ = {', '.join(f'{100 * std:.3g}' for std in placement.std)} %, gap {100 * placement.gap:.2g} %")
    axes.plot(x[4:-4][placement.gauges], np.full(4, -row), "s", label=name)
axes.plot(x[[8, 20, 30]], np.ones(3), "kv", label="forces")
axes.set(xlabel="x [m]", yticks=[], xlim=(0, 1))
axes.legend(loc="center left", bbox_to_anchor=(1, 0.5));
