"""A picture of the structure with its gauges, rendered off-screen in a child process (`offscreen` says why)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.report.picture.layout import Gauge, Layout, Load
from strainsight.report.picture.offscreen import answer, draw_apart

WIDTH, HEIGHT = 640, 420
"""As the page shows it [px]; the PNG has `picture.FINER` times as many pixels each way."""
TIME_LIMIT = 120.0
"""For the first picture [s]."""
TIME_A_PICTURE = 20.0
"""For every further one [s]."""
DOTS = 4000


def render(layout: Layout) -> bytes:
    """PNG of 1280 × 840 pixels on a transparent ground, for light and dark pages alike.

    Shows the facets with their edges, the candidate pool as dots, sensors as labelled marks by their kind
    (`markers.marker`), loads as arrows, clamped nodes as squares; two views where one corner does not show every gauge.
    Raises StrainsightError that names the Debian packages where nothing can render.
    """
    return render_all([layout])[0]


def render_all(layouts: Sequence[Layout]) -> list[bytes]:
    """A picture of each, as `render` makes it, in one child process: to start it takes longer than to draw."""
    limit = TIME_LIMIT + TIME_A_PICTURE * (len(layouts) - 1)
    arrays = {f"{i}/{name}": array for i, layout in enumerate(layouts) for name, array in pack(layout).items()}
    return draw_apart("strainsight.report.picture.scene", {"layouts": np.array(len(layouts)), **arrays}, limit)


def pack(layout: Layout) -> dict[str, np.ndarray]:
    """The layout as plain arrays, as the child process reads them; a large pool is thinned to what one can see."""
    stride = max(1, -(-len(layout.pool) // DOTS))
    gauges, loads = layout.gauges, layout.loads
    return {
        "points": np.asarray(layout.points, dtype=float),
        "faces": np.asarray(layout.faces, dtype=np.int64),
        "pool": np.asarray(layout.pool, dtype=float).reshape(-1, 3)[::stride],
        "fixed": np.asarray(layout.fixed, dtype=float).reshape(-1, 3)[:: max(1, -(-len(layout.fixed) // DOTS))],
        "loose": np.asarray(layout.loose, dtype=float).reshape(-1, 3)[:: max(1, -(-len(layout.loose) // DOTS))],
        "gauge_label": np.array([gauge.label for gauge in gauges], dtype=str),
        "gauge_position": np.array([gauge.position for gauge in gauges], dtype=float).reshape(-1, 3),
        "gauge_direction": np.array([gauge.direction for gauge in gauges], dtype=float).reshape(-1, 3),
        "gauge_normal": np.array([gauge.normal for gauge in gauges], dtype=float).reshape(-1, 3),
        "gauge_kind": np.array([gauge.kind for gauge in gauges], dtype=str),
        "gauge_bonded": np.array([gauge.bonded for gauge in gauges], dtype=bool),
        "gauge_channels": np.array([len(gauge.channels) for gauge in gauges], dtype=np.int64),
        "channel_direction": np.concatenate([np.empty((0, 3)), *(gauge.channels for gauge in gauges)]),
        "load_name": np.array([load.name for load in loads], dtype=str),
        "load_point": np.array([load.point for load in loads], dtype=float).reshape(-1, 3),
        "load_direction": np.array([load.direction for load in loads], dtype=float).reshape(-1, 3),
        "load_known": np.array([load.known for load in loads], dtype=bool),
    }


def unpack(arrays: dict[str, np.ndarray]) -> Layout:
    """The layout that `pack` flattened, as far as a picture needs it."""
    channels = np.split(arrays["channel_direction"], np.cumsum(arrays["gauge_channels"])[:-1])
    gauges = tuple(
        Gauge(str(label), 0, 0, position, direction, normal, 0.0, kind=str(kind), directions=axes, bonded=bool(bonded))
        for label, position, direction, normal, kind, bonded, axes in zip(
            *(arrays[f"gauge_{name}"] for name in ("label", "position", "direction", "normal", "kind", "bonded")),
            channels[: len(arrays["gauge_label"])],
            strict=True,
        )
    )
    loads = tuple(
        Load(str(name), point, direction, bool(known))
        for name, point, direction, known in zip(
            *(arrays[f"load_{name}"] for name in ("name", "point", "direction", "known")), strict=True
        )
    )
    return Layout(arrays["points"], arrays["faces"], arrays["pool"], gauges, loads, arrays["fixed"], arrays["loose"])


def drawn(arrays: dict[str, np.ndarray]) -> list[bytes]:
    """In the child process: a picture of every layout of `render_all`."""
    from strainsight.report.picture.picture import draw

    found: list[dict[str, np.ndarray]] = [{} for _ in range(int(arrays["layouts"]))]
    for key, array in arrays.items():
        place, slash, name = key.partition("/")
        if slash:
            found[int(place)][name] = array
    return [draw(unpack(layout), WIDTH, HEIGHT) for layout in found]


if __name__ == "__main__":
    answer(drawn)
