"""Names and numbers of a deck as YAML."""

from __future__ import annotations

import json
import re

WORDS = ("null", "true", "false", "yes", "no", "on", "off", "y", "n")
"""Words that YAML does not read as text."""


def escaped(text: str) -> str:
    """Text for quotes or a comment, with line breaks such as U+2028 as escapes."""
    quotes_escaped = json.dumps(text, ensure_ascii=False)[1:-1]
    return "".join(sign if sign.isprintable() else f"\\U{ord(sign):08x}" for sign in quotes_escaped)


def quoted(text: str) -> str:
    """Text as YAML: without quotes if it is a plain word or a path, otherwise as a JSON string, which is valid YAML."""
    word = re.fullmatch(r"(\.{0,2}/)?[A-Za-z][A-Za-z0-9_./-]*|(\.\./)+[A-Za-z0-9_./-]+", text)
    return text if word and text.lower() not in WORDS else f'"{escaped(text)}"'


def plain(value: float | None, digits: int = 4) -> str:
    """A number with four digits in YAML form: 1250.0, 1e-05; empty for None."""
    return "" if value is None else repr(float(f"{value:.{digits}g}"))


def exact(value: float | None) -> str:
    """A number with the smallest number of digits, at least four, that represents it exactly; empty for None."""
    if value is None:
        return ""
    texts = (f"{value:.{digits}e}".replace("e+", "e") for digits in range(3, 17))
    return next(text for text in texts if float(text) == value)


def scientific(value: float | None) -> str:
    """A number with four digits and a power of ten; empty for None."""
    return "" if value is None else f"{value:.3e}".replace("e+", "e")
