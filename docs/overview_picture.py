"""Draw docs/images/overview.svg, the picture of the first page: model and gauges, readings, estimated load, strain field.

`python docs/overview_picture.py`, after the example or the method changed. The data are those of docs/examples/test.yaml.
"""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from strainsight import api

ROOT = Path(__file__).resolve().parents[1]
DEPTH = np.array([0.5, 0.35])
"""Shift on the page per metre of depth."""
LABELS = ((3, 5), (-18, -3), (6, -3), (3, 5))
"""Offset of each gauge's label [points]."""
GREY, BLUE, RED = "#5f6b76", "#0072b2", "#d55e00"


def project(points):
    """Positions on the page (n, 2) of points (n, 3): x to the right, z upwards, y into the page."""
    return points[:, [0, 2]] + np.outer(points[:, 1], DEPTH)


def faces_viewer(points):
    """Whether a facet (4, 3) is visible."""
    (ax, ay), (bx, by) = np.diff(project(points), axis=0)[:2]
    return ax * by - ay * bx > 0


def draw_body(axes, polygons, **style):
    axes.add_collection(PolyCollection(polygons, linewidths=0.3, rasterized=True, **style))
    axes.set(xlim=(-0.15, 2.2), ylim=(-0.28, 0.42), aspect="equal")
    axes.set_axis_off()


def draw(test, training, gauges, readings, picture):
    force, std, time = test.estimated.smoothed["tip"], test.estimated.smoothed_std["tip"], test.estimated.time
    facets = [np.asarray(cell.points) for cell in picture.cell]
    visible = [i for i, points in enumerate(facets) if faces_viewer(points)]
    polygons = [project(facets[i]) for i in visible]
    strain = 1e6 * picture.cell_data["strain"][visible, 0]

    figure = Figure(figsize=(10.4, 4.4), layout="constrained")
    body, signals, load, field = figure.subplots(2, 2).flat
    draw_body(body, polygons, facecolors="#eef2f5", edgecolors=GREY)
    body.plot(*project(gauges).T, "s", color=RED, markersize=6)
    for number, position in enumerate(project(gauges), start=1):
        body.annotate(f"G{number}", position, LABELS[number - 1], textcoords="offset points", color=RED, fontsize=9)
    body.annotate("", (2.0, 0.33), (2.0, 0.1), arrowprops={"arrowstyle": "->", "color": "black", "linewidth": 1.5})
    body.text(2.03, 0.25, "F ?", fontsize=10)
    body.set_title("1  finite-element model and gauges", loc="left")

    signals.plot(time, readings, linewidth=0.8)
    signals.set(xlabel="time [s]", ylabel="strain [µm/m]", xlim=(0, 0.4))
    signals.set_title("2  measured strain", loc="left")

    load.fill_between(time, (force - 2 * std) / 1e3, (force + 2 * std) / 1e3, alpha=0.3, color=BLUE, label="± 2σ")
    load.plot(time, force / 1e3, color=BLUE, linewidth=1, label="estimate")
    load.plot(training.time, training.load[:, 0] / 1e3, "k--", linewidth=0.7, label="true force")
    load.set(xlabel="time [s]", ylabel="force [kN]", xlim=(0, 0.4))
    load.legend(fontsize=7, ncols=3, loc="lower left")
    load.set_title("3  estimated load with its uncertainty", loc="left")

    largest = np.abs(strain).max()
    draw_body(field, polygons, array=strain, cmap="coolwarm", clim=(-largest, largest), edgecolors="face")
    figure.colorbar(field.collections[0], ax=field, shrink=0.8, label="strain [µm/m]")
    field.set_title("4  estimated strain of the whole surface", loc="left")
    return figure


def main():
    case = api.load(ROOT / "docs/examples/test.yaml")
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    screened = api.screen(case, mesh, reduced, training)
    test = api.estimate(case, mesh, reduced, training, screened)
    gauges = np.genfromtxt(ROOT / "docs/examples/bonded.csv", delimiter=",", skip_header=1)[:, 1:4]
    table = np.genfromtxt(ROOT / "docs/examples/test.csv", delimiter=",", skip_header=1)
    readings = np.array([np.interp(test.estimated.time, table[:, 0], column) for column in table[:, 1:].T]).T
    pictures = [api.to_pyvista(test.surface, step) for step in range(len(test.surface.datasets["Steps/Values"]))]
    picture = max(pictures, key=lambda each: np.abs(each.cell_data["strain"][:, 0]).max())
    # Equal pictures are equal files.
    with rc_context({"svg.hashsalt": "strainsight", "font.size": 9, "axes.titlesize": 10, "axes.titleweight": "bold"}):
        figure = draw(test, training, gauges, readings, picture)
        figure.savefig(ROOT / "docs/images/overview.svg", metadata={"Date": None}, dpi=200)


if __name__ == "__main__":
    main()
