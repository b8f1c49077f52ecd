# ---
# jupyter:
#   kernelspec: {name: python3, display_name: Python 3, language: python}
# ---

# %% [markdown]
# # Estimate a load and the strain field from a test
#
# `test.csv` has the readings of four gauges in µm/m, sampled every millisecond. `test.yaml` assigns the columns to the
# gauges, and `bonded.csv` lists their positions. The file was simulated with errors that the model does not contain: more
# modes, other damping, misplaced gauges. The load is a force at the tip that sweeps from 5 to 60 Hz.

# %%
import matplotlib.pyplot as plt
import numpy as np
import pyvista

from strainsight import api

case = api.load("../examples/test.yaml")
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)
test = api.estimate(case, mesh, reduced, training, screened)

# %% [markdown]
# ## Load
#
# The training simulation has the same sweep, so its load is the true one.

# %%
time = test.estimated.time
force, std = test.estimated.smoothed["tip"], test.estimated.smoothed_std["tip"]
true = training.load[:, 0]
print(f"force: RMS {np.sqrt(np.mean(force**2)):.0f} N, σ {np.sqrt(np.mean(std**2)):.0f} N")
print(f"error: {100 * np.linalg.norm(force - true) / np.linalg.norm(true):.1f} % of the force")
print(test.innovation_check.text)

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.fill_between(time, (force - 2 * std) / 1e3, (force + 2 * std) / 1e3, alpha=0.3, label="± 2σ")
axes.plot(time, force / 1e3, label="estimate")
axes.plot(training.time, true / 1e3, "k--", linewidth=0.8, label="true force")
axes.set(xlabel="time [s]", ylabel="force [kN]")
axes.legend(loc="upper left");

# %% [markdown]
# ## Strain field
#
# With `estimate.field` the result holds the strain of the whole surface every 10 ms, with its σ. The picture shows the
# instant of the largest strain.

# %%
steps = test.surface.datasets["Steps/Values"]
pictures = [api.to_pyvista(test.surface, step) for step in range(len(steps))]
largest = int(np.argmax([np.abs(picture.cell_data["strain"][:, 0]).max() for picture in pictures]))
surface = pictures[largest]
surface.cell_data["axial strain [µm/m]"] = 1e6 * surface.cell_data["strain"][:, 0]
facet = int(np.argmax(np.abs(surface.cell_data["strain"][:, 0])))
strain, spread = 1e6 * surface.cell_data["strain"][facet, 0], 1e6 * surface.cell_data["strain_std"][facet, 0]
centre = surface.cell_centers().points[facet].round(2)
print(f"largest at {steps[largest]:.2f} s: {strain:.0f} ± {spread:.0f} µm/m at", *centre, "m")

plotter = pyvista.Plotter(off_screen=True, window_size=(900, 400))
plotter.add_mesh(surface.warp_by_vector("displacement", factor=30), scalars="axial strain [µm/m]", cmap="coolwarm")
plotter.camera_position = [(1.2, -2.6, 0.9), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
figure, axes = plt.subplots(figsize=(9, 4), layout="constrained")
axes.imshow(plotter.screenshot(return_img=True))
axes.set_axis_off()
