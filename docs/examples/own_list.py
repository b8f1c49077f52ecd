"""What a list of your own lets you know."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from strainsight import api

case = api.load("configs/cantilever-youngs-modulus.yaml", ["place.instants=5"])
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)

# Four places that somebody has drawn on the part, in m: two at a third of its length, two at half of it. Gauges go by number,
# and the nearest candidate is taken for each; `gauges.fixed` in a config takes the coordinates themselves.
drawn = np.array([[0.6, 0.03, 0.1], [0.6, 0.03, -0.1], [1.0, -0.03, 0.1], [1.0, -0.03, -0.1]])
position = training.candidates.position[training.candidates.first]
own = [int(np.argmin(np.linalg.norm(position - place, axis=1))) for place in drawn]

# What a filter on them will claim to know of E; the same for the layout that `place` chooses.
listed = api.expect(case, mesh, reduced, training, screened, own)
layout = api.place(case, mesh, reduced, training, screened)
print(f"your list: σ of E {100 * listed.std['E']:.3g} %")
print(f"the layout of `place`: {100 * layout.expected.std['E']:.3g} %")

# And without each gauge in turn: a gauge whose loss costs little is redundant.
for i, std in enumerate(listed.without["E"]):
    print(f"without gauge {i + 1} of your list: {100 * std:.3g} %")

figure = Figure(figsize=(6, 3), layout="constrained")
axes = figure.add_subplot(xlabel="gauge that fails", ylabel="σ of E [%]")
for offset, words, expected in ((-0.2, "your list", listed), (0.2, "place", layout.expected)):
    axes.bar(np.arange(1, 5) + offset, 100 * expected.without["E"], 0.4, label=words)
axes.set_xticks(range(1, 5))
axes.legend()
figure.savefig(Path(__file__).with_suffix(".svg"))
