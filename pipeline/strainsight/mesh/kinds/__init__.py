"""The kinds of elements and facets: a record of each. A new element is a record in `solids` and an entry in `ELEMENTS`."""

from __future__ import annotations

from strainsight.errors import DeckError
from strainsight.mesh.kinds.kind import QUAD4, QUAD8, SHELL6, SHELL8, TRI3, TRI6, ElementKind, Kind
from strainsight.mesh.kinds.solids import HEX8, HEX20, PYRA5, TET4, TET10, WEDGE6, WEDGE15

FACETS = (TRI3, TRI6, QUAD4, QUAD8, SHELL6, SHELL8)
"""The codes of facets in artefacts are indices into this tuple."""
ELEMENTS = (TET4, TET10, HEX8, HEX20, WEDGE6, WEDGE15, PYRA5)
_BY_NAME = {kind.name: kind for kind in ELEMENTS}
*_FIRST, _LAST = dict.fromkeys(kind.family for kind in ELEMENTS)
FAMILIES = f"{', '.join(_FIRST)} or {_LAST}"
"""Text in remedies."""


def kind_of(name: str) -> ElementKind:
    """The kind of this name, as of a `CellBlock`. Raises DeckError for an unsupported one."""
    if name not in _BY_NAME:
        raise DeckError(f"element kind {name!r} is not supported", remedy=f"Use one of {', '.join(_BY_NAME)}.")
    return _BY_NAME[name]


def facet_of(name: str) -> Kind:
    """The facet of this name, which is one of `FACETS`."""
    return next(kind for kind in FACETS if kind.name == name)
