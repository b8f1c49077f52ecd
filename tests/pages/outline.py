"""A page read back: its tags, its texts, its scripts, and what a cell, a row or a table of it says."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from hashlib import sha256
from html.parser import HTMLParser
from itertools import pairwise

from strainsight.config.placement import Report

HOSTILE = "\"><img src=x onerror='1'><script>alert(1)</script> 力 & Ж $x^2 \\frac{"
"""A name that is markup, breaks out of quotes, is no ASCII and begins a formula."""
VOID = {"meta", "img", "br", "link", "input", "wbr"}


class Outline(HTMLParser):
    """Tags in order, with a check that each is closed; texts; scripts as (attributes, text)."""

    def __init__(self, text: str):
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []
        self.scripts: list[tuple[dict[str, str], str]] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append((dict(attrs), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            attributes, text = self.scripts.pop()
            self.scripts.append((attributes, text + data))
        else:
            self.text.append(data)

    @property
    def tags(self) -> set[str]:
        return {tag for tag, _ in self.seen}

    @property
    def ids(self) -> list[str]:
        return [attributes["id"] for _, attributes in self.seen if "id" in attributes]

    @property
    def targets(self) -> set[str]:
        return {a["href"][1:] for _, a in self.seen if a.get("href", "").startswith("#")}

    @property
    def levels(self) -> list[int]:
        return [int(tag[1]) for tag, _ in self.seen if re.fullmatch("h[1-6]", tag)]


def nothing_comes_from_outside(text: str) -> Outline:
    """Nothing is fetched, and nothing runs but scripts that the page's policy names by their digests, none more."""
    outline = Outline(text)
    markup = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert not re.search(r"https?:|//[a-z]|@import|url\((?!#)", markup)
    assert not re.search(r"\b(fetch|import|XMLHttpRequest|WebSocket|eval|Function)\s*\(", "".join(own_scripts(outline)))
    assert outline.tags.isdisjoint({"link", "iframe", "object", "embed", "base", "form"})
    assert not any(name.startswith("on") for _, attributes in outline.seen for name in attributes)
    assert all(a["src"].startswith("data:image/png;base64,") for _, a in outline.seen if "src" in a)
    (policy,) = [a["content"] for tag, a in outline.seen if a.get("http-equiv") == "Content-Security-Policy"]
    digests = [base64.b64encode(sha256(script.encode()).digest()).decode() for script in own_scripts(outline)]
    allowed = "script-src " + " ".join(f"'sha256-{digest}'" for digest in digests)
    assert policy == f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; {allowed}"
    assert digests
    return outline


def whole(text: str) -> Outline:
    """A well-formed page that fetches nothing, whose links within it lead somewhere and whose regions differ in their names."""
    outline = nothing_comes_from_outside(text)
    assert len(outline.ids) == len(set(outline.ids))
    assert outline.targets <= set(outline.ids)
    assert steps_in_order(outline)
    regions = names_of_regions(outline)
    assert len(regions) == len(set(regions))
    return outline


KEPT = {"kind", "result", "metric", "metrics", "frame", "sha256"}
"""Fields whose texts are chosen by the program."""


def renamed(value: object, name: str = HOSTILE) -> object:
    """Every text of a report replaced by a name: of records, tuples and mappings, whose keys stay different."""
    if isinstance(value, str):
        return name
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: renamed(getattr(value, f.name), name) for f in fields(value) if f.name not in KEPT})
    if isinstance(value, Report):
        return value.model_copy(update={"remark": f"{name}\n{name}"})
    if isinstance(value, tuple):
        return tuple(renamed(item, name) for item in value)
    if isinstance(value, Mapping):
        return {f"{name}{i or ''}": renamed(item, name) for i, item in enumerate(value.values())}
    return value


def own_scripts(outline: Outline) -> list[str]:
    """Texts of the scripts that run; what is left is data."""
    kinds = {"module": [], "application/json": []}
    for attributes, text in outline.scripts:
        kinds[attributes["type"]].append(text)
    return kinds["module"]


def names_of_regions(outline: Outline) -> list[str]:
    """What those who hear the page can jump to."""
    regions = [a for tag, a in outline.seen if a.get("role") == "region" or tag == "nav" or tag == "section"]
    return [attributes["aria-label"] for attributes in regions if "aria-label" in attributes]


def steps_in_order(outline: Outline) -> bool:
    """Headings begin at the first level and go down by one at a time."""
    levels = outline.levels
    return levels[0] == 1 and levels.count(1) == 1 and all(b <= a + 1 for a, b in pairwise(levels))


def words(html: str) -> str:
    return " ".join(re.sub(r"<[^>]*>", " ", html).split())
