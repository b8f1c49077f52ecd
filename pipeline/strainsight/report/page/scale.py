"""The bar that says which colour is which value."""

from __future__ import annotations

from html import escape

from strainsight.report.picture.colours import Scale, gradient
from strainsight.report.text import number


def scale_bar(scale: Scale) -> str:
    """Colours from low to high with their values, in words for those who do not see them."""
    low, middle, high = (number(value, 3) for value in (scale.low, (scale.low + scale.high) / 2, scale.high))
    low, high = "≤\u00a0" * scale.below + low, "≥\u00a0" * scale.above + high
    said = escape(f"{scale.quantity} from {low} to {high} {scale.unit}")
    return (
        f'<div class="scale" role="img" aria-label="{said}"><p>{escape(scale.quantity)} [{escape(scale.unit)}]</p>'
        f'<i style="background:{gradient(scale)}"></i><p class="ends"><span>{low}</span><span>{middle}</span>'
        f"<span>{high}</span></p></div>"
    )
