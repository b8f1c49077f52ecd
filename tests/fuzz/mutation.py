"""A file and a seed in, a damaged file out: bytes, lines, words, numbers, nesting, packing, encoding."""

from __future__ import annotations

import ast
import gzip
import re
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD]?[-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_$*%!][\w$*%!]*")
HOSTILE = [
    *(
        "", "0", "-0", "-1", "1", "2", "7", "NaN", "nan", "-inf", "inf", "Infinity", "1e400", "-1e400", "1e308",
        "1e-320",
    ),
    *("1000000000", "999999999999", "1000000000000", "2147483647", "2147483648", "4294967296", "-2147483648"),
    *("9223372036854775807", "9223372036854775808", "18446744073709551615", "1" + "0" * 30, "9" * 400, "9" * 5000),
    *("1.5", "1.7-4", "1.d0", "1_000", "0x10", "0o17", "1,5", "٣", "½", "1e", "--1", "+", "1 2", "true", "null", "~"),
]
"""What stands in the place of a number."""
NESTING = ["[", "{a: ", "- ", "(", "<a>", "<DataArray>", "? ", "{", '"', "'", "*", "&a ", "!!python/object:", "\t"]
SIGNS = ["\0", "\r", "\n", "\r\n", "\u2028", "\x85", "\x1b[2J", "\x1b]0;x\x07", "\x0c", "\ufeff", "\u202e", "é", "\x7f"]
INTEGERS = [0, 1, -1, 2, 255, 2**15, 2**16, 2**31 - 1, -(2**31), 2**32 - 1, 10**9, 2**40, 2**62, 2**63 - 1, -(2**63)]
LARGEST = 64_000
"""[bytes] of a damaged file: what is slow in a large one shows in the time of a small one."""


def mutated(content: bytes, rng: Random, words: Sequence[str], others: Sequence[bytes] = ()) -> bytes:
    """The content after one to six alterations; words: of the format, some of them whole lines; others: to cross it with."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        if others and rng.random() < 0.04:
            content = _crossed(content, rng.choice(others), rng)
        else:
            content = rng.choices(WAYS, WEIGHTS)[0](content, rng, words)[:LARGEST]
    return content


def packed(content: bytes, rng: Random) -> bytes:
    whole = gzip.compress(content, 1, mtime=0)
    return rng.choice((_flipped, _cut))(whole, rng, ()) if rng.random() < 1 / 3 else whole


def words_in(*folders: Path) -> list[str]:
    """Short texts that the modules of these folders (or the modules themselves) compare with: the words of their formats."""
    found: dict[str, None] = {}
    for folder in folders:
        for module in sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]:
            for node in ast.walk(ast.parse(module.read_text("utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) <= 24:
                    found[node.value] = None
    return list(found)


def _spot(content: bytes, rng: Random) -> int:
    """A place, every other time among the first two hundred: heads and counts stand there."""
    return rng.randrange(min(len(content), 200) + 1) if rng.random() < 0.5 else rng.randrange(len(content) + 1)


def _flipped(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    data = bytearray(content or b"\0")
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = min(_spot(content, rng), len(data) - 1)
        data[at] = rng.randrange(256) if rng.random() < 0.5 else data[at] ^ (1 << rng.randrange(8))
    return bytes(data)


def _cut(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    a, b = sorted((_spot(content, rng), _spot(content, rng)))
    return content[:a] if rng.random() < 0.5 else content[:a] + content[b:]


def _lines(content: bytes, rng: Random, words: Sequence[str]) -> bytes:
    """A line twice, a thousand times, gone, at another place, or one of another format."""
    lines = content.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            lines[i:i] = [lines[j]] * rng.choice((1, 1, 2, 10, 1000))
        case 1:
            del lines[i]
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i : i + rng.randrange(1, 20)] = []
        case 4:
            lines[i:i] = [_word(words, rng)]
    return b"\n".join(lines)


def _word(words: Sequence[str], rng: Random) -> bytes:
    return rng.choice(words or SIGNS).encode()


def _replaced(pattern: re.Pattern[bytes], content: bytes, new: bytes, rng: Random) -> bytes:
    """One find of the pattern replaced, now and then every find of the same text."""
    start = _spot(content, rng)
    found = pattern.search(content, start) or pattern.search(content)
    if found is None:
        return content[:start] + new + content[start:]
    if rng.random() < 0.1:
        return content.replace(found[0], new)
    return content[: found.start()] + new + content[found.end() :]


def _numbers(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        content = _replaced(NUMBER, content, rng.choice(HOSTILE).encode(), rng)[:LARGEST]
    return content


def _spliced(content: bytes, rng: Random, words: Sequence[str]) -> bytes:
    new = _word(words, rng)
    if rng.random() < 0.6:
        return _replaced(WORD, content, new, rng)
    at = _spot(content, rng)
    return (
        content[:at] + rng.choice((b"", b" ", b"\n", b", ")) + new + rng.choice((b"", b" ", b"\n", b"=")) + content[at:]
    )


def _nested(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    at, many = _spot(content, rng), rng.choice((1, 3, 30, 300, 3000))
    return content[:at] + rng.choice(NESTING).encode() * many + content[at:]


def _signs(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    at = _spot(content, rng)
    return content[:at] + rng.choice(SIGNS).encode() * rng.choice((1, 1, 5, 500)) + content[at:]


def _encoded(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    match rng.randrange(4):
        case 0:
            name = rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-7", "utf-8-sig", "cp037"))
            return content.decode("latin-1").encode(name, "replace")
        case 1:
            return content.replace(b"\n", rng.choice((b"\r", b"\r\n", b"\n\r", b"\n\n", b" ", b"")))
        case 2:
            return content.replace(b" ", rng.choice((b"\t", b"", b"\xa0", b"  ")))
        case _:
            return content.swapcase()


def _binary(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    """An integer of four or eight bytes of either order written over some bytes."""
    width = rng.choice("iq")
    new = struct.pack(rng.choice("<>") + width, rng.choice(INTEGERS) % 2 ** (31 if width == "i" else 63))
    at = _spot(content, rng) & ~3
    return content[:at] + new + content[at + len(new) :]


def _repeated(content: bytes, rng: Random, _: Sequence[str]) -> bytes:
    a, b = sorted((_spot(content, rng), _spot(content, rng)))
    return content[:b] + content[a:b] * rng.choice((1, 2, 20)) + content[b:]


def _crossed(content: bytes, other: bytes, rng: Random) -> bytes:
    return content[: _spot(content, rng)] + other[_spot(other, rng) :]


Way = Callable[[bytes, Random, Sequence[str]], bytes]
WAYS: list[Way] = [_numbers, _spliced, _lines, _flipped, _cut, _nested, _signs, _repeated, _binary, _encoded]
WEIGHTS = [5, 4, 3, 3, 2, 1, 1, 1, 1, 0.5]
"""How often each is taken."""
