# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Estimate the load on a bench
#
# A flexible beam carries a rigid arm with a mass. The force at the end of the arm is estimated from three gauges on the
# beam while the arm moves.

# %%
import matplotlib.pyplot as plt
import numpy as np

from strainsight import api

bench = api.bench("../gallery/bench.yaml")
meshes = bench.meshes()
bodies = bench.reduce(meshes)
print("natural frequencies of the beam:", *bodies["beam"].frequency[:3].round(1), "Hz")

# %% [markdown]
# ## Place three gauges
#
# The placement linearises the bench about its static equilibrium. σ is that of the force in N.

# %%
layout = bench.place(meshes, bodies)
for position in layout.final.position:
    print("gauge at", *position.round(3), "m")

# %% [markdown]
# ## Simulate the bench and its gauges

# %%
motion = bench.simulate(meshes, bodies, layout)
readings = 1e6 * motion.sensors["gauges"]
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(motion.time, readings, label=[f"G{i + 1}" for i in range(readings.shape[1])])
axes.set(xlabel="time [s]", ylabel="strain [µm/m]")
axes.legend();

# %% [markdown]
# ## Estimate the force
#
# The filter uses the same bench with the force as a random walk. The true force is known here because the test is
# simulated.

# %%
estimate = bench.estimate(meshes, bodies, layout)
pull = estimate.inputs["pull"]
force, std, true = pull.estimate, pull.std, pull.true
half = len(force) // 2
error = np.sqrt(np.mean((force - true)[half:] ** 2)) / np.abs(true).max()
print(f"error: {100 * error:.1f} % of the largest force (RMS, second half)")

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.fill_between(estimate.time, (force - 2 * std) / 1e3, (force + 2 * std) / 1e3, alpha=0.3, label="± 2σ")
axes.plot(estimate.time, force / 1e3, label="estimate")
axes.plot(estimate.time, true / 1e3, "k--", linewidth=0.8, label="true force")
axes.set(xlabel="time [s]", ylabel="force [kN]")
axes.legend();
