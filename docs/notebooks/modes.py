# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Place gauges on modes given as arrays
#
# If modes and strains come from another program or from a formula, no mesh is needed. This notebook places gauges on a
# simply supported beam, whose modes are sines, and checks the expected σ with a simulation of the Kalman filter.

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm

from strainsight import api

length, count = 1.0, 41
x = np.linspace(0, length, count)
wave = np.pi * np.arange(1, 4) / length
mass = 2.0  # of the beam [kg]
modes = np.sqrt(2 / mass) * np.sin(np.outer(x, wave))  # modal mass 1
frequencies = np.array([11.1, 44.4, 100.0])  # [Hz]

# %% [markdown]
# The strain operator maps the deflection to the bending strain at 4 mm from the neutral axis, ε = −z w″. The rows are the
# candidates, and the load is one unknown force at a quarter of the length.

# %%
curvature = np.gradient(np.gradient(np.eye(count), x, axis=0), x, axis=0)
strain_operator = -0.004 * curvature[4:-4]
loads = np.zeros((count, 1))
loads[10] = 1.0
placement = api.place_modes(
    modes, frequencies, 0.02, strain_operator, keep=2, loads=loads, amplitude=20.0, noise=1e-6, names=["force"]
)
position = x[4:-4][placement.gauges]
print("gauges at", *position.round(3), "m")
print(f"σ of the force: {100 * placement.std[0]:.3g} % of 20 N, with every candidate {100 * placement.std_of_pool[0]:.3g} %")
print(f"no layout of two gauges has a variance lower by more than {100 * placement.gap:.2g} %")

# %%
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(x, modes, linewidth=1, label=[f"mode {i}" for i in (1, 2, 3)])
axes.plot(position, np.zeros(len(position)), "s", color="crimson", label="gauges")
axes.plot(x[10], 0, "kv", label="force")
axes.set(xlabel="x [m]", ylabel="mode shape [1/√kg]")
axes.legend(ncols=2);

# %% [markdown]
# ## How many gauges?

# %%
counts = np.arange(1, 9)
std = [
    api.place_modes(modes, frequencies, 0.02, strain_operator, keep=int(k), loads=loads, amplitude=20.0, noise=1e-6).std[0]
    for k in counts
]
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(counts, 100 * np.array(std), "o-")
axes.axhline(100 * placement.std_of_pool[0], color="grey", linestyle=":", label="all candidates")
axes.set(xlabel="number of gauges", ylabel="σ of the force [%]", ylim=(0, None))
axes.legend();

# %% [markdown]
# ## Check σ by simulation
#
# `place_arrays` does the same for any linear system ẋ = F x + w, y = H x + v. Here is a random system with its steady
# Kalman filter: the RMS error of a simulation agrees with the σ of the placement. Q and R are intensities; noise of
# standard deviation σ, sampled every h seconds, has σ²h.

# %%
rng = np.random.default_rng(1)
F, H = rng.normal(size=(4, 4)) - 2 * np.eye(4), rng.normal(size=(12, 4))
Q, R, h = np.eye(4), np.full(12, 0.5), 0.01
layout = api.place_arrays(F, H, Q, R, keep=3, states=[0, 1])
G, r = H[layout.gauges], np.diag(R[layout.gauges])
A, gain = expm(F * h), layout.P @ G.T @ np.linalg.inv(r) * h
state, estimate, errors = np.zeros(4), np.zeros(4), []
for _ in range(100_000):
    state = A @ state + np.sqrt(h) * rng.normal(size=4)
    reading = G @ state + np.sqrt(np.diag(r) / h) * rng.normal(size=3)
    predicted = A @ estimate
    estimate = predicted + gain @ (reading - G @ predicted)
    errors.append((state - estimate)[:2])
print("σ of the placement: ", *layout.std.round(3))
print("RMS of the error:   ", *np.sqrt(np.mean(np.square(errors), axis=0)).round(3))
