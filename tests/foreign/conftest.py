"""A box of every solid kind, as the tests of `fem` have it."""

from ..fem.conftest import box

__all__ = ["box"]
