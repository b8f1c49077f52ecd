"""What a command prints: nothing that a terminal obeys, and no line that a name makes up."""

from __future__ import annotations

import json
import sys
from typing import Any

from strainsight.errors import printable


def say(*lines: str, error: bool = False) -> None:
    """Print each on a line of its own, at once, with control characters, also a line break, as escapes; error: on stderr."""
    for line in lines:
        print(printable(line), file=sys.stderr if error else sys.stdout, flush=True)


def json_line(entry: Any) -> str:
    """An object of --json, whose text is read back as it was."""
    return "".join(
        c if c.isprintable() else json.dumps(c)[1:-1] for c in json.dumps(entry, ensure_ascii=False, allow_nan=False)
    )
