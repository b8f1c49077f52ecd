"""Four gauges on a cantilever."""

from strainsight import api

# A config names the deck, the loads, what is unknown and how noisy a gauge is. Each step is a function, and gives what the
# stage of that name writes.
case = api.load("configs/cantilever-youngs-modulus.yaml")
mesh = api.mesh(case)
reduced = api.reduce(case, mesh)
training = api.train(case, mesh, reduced)
screened = api.screen(case, mesh, reduced, training)
layout = api.place(case, mesh, reduced, training, screened)

# Where to bond them, and what they will let you know.
for label, position in zip(layout.listed.labels, layout.listed.position, strict=True):
    print(label, "at", *position.round(3), "m")
print(f"σ of E that the filter will claim: {100 * layout.expected.std['E']:.2g} %")
print(*layout.advice, sep="\n")
