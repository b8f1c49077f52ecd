"""Text that can be sent on: no absolute path tells where it was computed."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

# In quotes a path may hold spaces; outside it ends at one. A word before the slash makes it a relative path or a fraction.
_QUOTED = re.compile(r"""(["'])/(?:[^"'\n]*/)?([^"'\n/]*)\1""")
_BARE = re.compile(r"""(?<![\w.…/)\]-])/(?:[^\s/"',;:()]+/)*([^\s/"',;:()]+)""")


def placeless(text: str, folders: Iterable[Path] = ()) -> str:
    """The text with paths below `folders`, the packages and the working directory relative to them, others by their name.

    `File "/home/…/site-packages/scipy/sparse/_csr.py"` becomes `File "scipy/sparse/_csr.py"`.
    """
    for root in _roots(folders):
        text = re.sub(rf"(?<![\w./-]){re.escape(root)}/(?=[^\s\"'])", "", text)
        text = re.sub(rf"(?<![\w./-]){re.escape(root)}(?![\w.-])/?", ".", text)
    text = _QUOTED.sub(r"\1…/\2\1", text)
    return _BARE.sub(r"…/\1", text)


def _roots(folders: Iterable[Path]) -> list[str]:
    """Folders that something may lie in, the deepest first."""
    known = [*folders, Path.cwd(), Path.home(), Path(tempfile.gettempdir()), Path(sys.prefix), *map(Path, sys.path)]
    roots = {str(path) for folder in known for path in (folder.absolute(), folder.resolve())}
    return sorted((root for root in roots if root != "/"), key=len, reverse=True)
