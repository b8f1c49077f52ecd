"""Which criterion, and how many gauges."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from strainsight import api

# Two unknown forces at the tip of the cantilever, three gauges, none of them bonded yet: with two unknowns there is more than
# one meaning of a good layout. What comes before the placement is the same for all of them.
CONFIG = "docs/examples/test.yaml"
SIDE = "{node: 2, direction: [0, 1, 0], known: false, signal: {type: sine, frequency: 10.0, amplitude: 1.0e+3}}"
TWO = [f"loads.side={SIDE}", "place.estimate=[tip, side]", "validate.initial_std={tip: 1, side: 1}"]
FEW = ["gauges.fixed_file=null", "place.keep=3", "place.instants=1"]
case = api.load(CONFIG, [*TWO, *FEW])
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)

# The trace weighs the variances, the determinant the area of the ellipse that they span, the worst eigenvalue its longest axis.
# The determinant makes one force well known at the cost of the other, the worst eigenvalue helps the one that is known least.
layouts = {}
for criterion in ("trace", "log_determinant", "worst_eigenvalue"):
    case = api.load(CONFIG, [*TWO, *FEW, f"place.criterion={criterion}"])
    layouts[criterion] = api.place(case, mesh, reduced, training, screened)
    std = layouts[criterion].expected.std
    print(f"{criterion}: σ of the force upwards {100 * std['tip']:.3g} %, sideways {100 * std['side']:.3g} %")

# The elimination passes every number of gauges on its way from the pool to three: its costs say what one more is worth.
# Halving the cost divides σ by √2. Where the curve is flat, another gauge only averages noise.
cost = layouts["trace"].elimination.cost
count = case.config.place.keep + np.arange(len(cost))[::-1]
for k in (3, 4, 6, 8, 16, 32):
    print(f"{k} gauges: tr(W P) = {cost[count == k][0]:.3g}")

figure = Figure(figsize=(6, 3), layout="constrained")
axes = figure.add_subplot(xlabel="gauges", ylabel="tr(W P)", xscale="log", yscale="log")
axes.plot(count, cost, color="#0072b2")
figure.savefig(Path(__file__).with_suffix(".svg"))
