"""What the type of the gauges gives, in words."""

from __future__ import annotations

from strainsight.config.gauge_types import gauge_type
from strainsight.config.placement import PlacementConfig
from strainsight.runner.output import Table


def type_in_words(config: PlacementConfig) -> str:
    """The type of the gauges that are to be bonded, and what of it was taken; empty where the config names none."""
    own = gauge_type(config.gauges)
    if own is None:
        return ""
    taken = [f"{what} {value}" for what, value, where in _rows(config) if where == config.gauges.type]
    source = f" ({own.source})" * bool(own.source)
    return f"gauges {config.gauges.type}{source}: {', '.join(taken)}"


def type_table(config: PlacementConfig) -> tuple[Table, ...]:
    """What holds for the gauges, and whether their type or a key of the config says so; no table where there is no type."""
    if gauge_type(config.gauges) is None:
        return ()
    return (Table(f"gauges {config.gauges.type}", ("what", "value", "from"), tuple(_rows(config))),)


def _rows(config: PlacementConfig) -> list[tuple[str, str, str]]:
    """What, its value, and where that comes from: what a key states as the type has it is the type's."""
    gauges, own = config.gauges, gauge_type(config.gauges)
    assert own is not None
    assert gauges.type is not None
    kind = gauges.type

    def of(value: float | None, typed: float, key: str) -> str:
        return kind if value == typed else key

    limit = "none" if gauges.range is None else f"{1e6 * gauges.range:.6g} µm/m"
    spacing = config.screen.minimum_spacing
    return [
        ("grid", _mm(gauges.grid_length), of(gauges.grid_length, own.grid_length, "gauges.grid_length")),
        ("carrier", f"{1e3 * own.carrier_length:.4g} × {_mm(own.carrier_width)}", kind),
        ("spacing", _mm(spacing), of(spacing, own.spacing, "screen.minimum_spacing")),
        ("range", limit, of(gauges.range, own.range, "gauges.range")),
        ("bend radius", _mm(own.bend_radius), kind),
        ("resistance", f"{own.resistance:.4g} Ω", kind),
        ("gauge factor", f"{own.gauge_factor:.4g} ± {100 * own.gauge_factor_tolerance:.2g} %", kind),
    ]


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"
