"""From the file of a test to a load and the strain of the whole surface."""

from pathlib import Path

import numpy as np
import pyvista

from strainsight import api

# test.csv has four gauges in µm/m, sampled every millisecond, with noise; test.yaml says which column is which gauge, bonded.csv
# where they sit. (The test was simulated: more modes, other damping, misplaced gauges, a force that sweeps from 5 to 60 Hz.)
case = api.load("docs/examples/test.yaml")
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)
test = api.estimate(case, mesh, reduced, training, screened)

# The force at the tip, and whether the innovations are what the stated noise makes of them.
force, std = test.estimated.smoothed["tip"], test.estimated.smoothed_std["tip"]
print(f"force: RMS {np.sqrt(np.mean(force**2)):.0f} N, σ {np.sqrt(np.mean(std**2)):.0f} N")
print(test.verdict.text)

# Training has the same sweep, so that its load is what was really there.
true = training.load[:, 0]
print(f"error: {100 * np.linalg.norm(force - true) / np.linalg.norm(true):.1f} % of the force")

# The strain everywhere, also where no gauge is: pictures every 10 ms, each with its σ. Here the one of the largest strain.
steps = test.surface.datasets["Steps/Values"]
pictures = [api.to_pyvista(test.surface, step) for step in range(len(steps))]
largest = int(np.argmax([np.abs(picture.cell_data["strain"][:, 0]).max() for picture in pictures]))
surface = pictures[largest]
surface.cell_data["axial strain [µm/m]"] = 1e6 * surface.cell_data["strain"][:, 0]
i = int(np.argmax(np.abs(surface.cell_data["strain"][:, 0])))
strain, spread = 1e6 * surface.cell_data["strain"][i, 0], 1e6 * surface.cell_data["strain_std"][i, 0]
print(
    f"largest at {steps[largest]:.2f} s: {strain:.0f} ± {spread:.0f} µm/m at",
    *surface.cell_centers().points[i].round(2),
)

plotter = pyvista.Plotter(off_screen=True, window_size=(900, 400))
plotter.add_mesh(surface.warp_by_vector("displacement", factor=30), scalars="axial strain [µm/m]", cmap="coolwarm")
plotter.camera_position = [(1.2, -2.6, 0.9), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
plotter.screenshot(Path(__file__).with_suffix(".png"))
