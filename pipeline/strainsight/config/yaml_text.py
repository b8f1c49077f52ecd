"""Parse YAML as JSON data with the location of every key: no tags, no anchors, no duplicate keys."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

LARGEST = 1 << 17
"""Size limit of a config file [B], about 280 runs of a suite; the slowest such file takes seven seconds."""

PREFIX = "tag:yaml.org,2002:"
INTEGER = re.compile(r"[-+]?[0-9]+$")
REMEDIES = (
    (r"'\\t' that cannot start", "use spaces, not tabs, for indentation and separation"),
    ("token$|undefined", "put quotes around the value"),
    ("expected <block end>, but found '(<block|\\?|-)", "use the same indentation as the neighbouring lines above"),
    (
        "mapping values",
        "use the same indentation as the neighbouring lines above; put quotes around a value that contains ': '",
    ),
    ("find expected ':'", "write KEY: VALUE in the line above, with a space after the colon"),
    (r"expected ',' or '[\]}]'", "close the bracket that was opened above, or separate its entries with commas"),
    ("unexpected end", "close the quotes that were opened above"),
    ("escape character", "use single quotes; in single quotes, a backslash has no special meaning"),
)
"""Parser message (a pattern) → remedy; the first match applies."""
BOOLEANS = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}


@dataclass(frozen=True)
class Mark:
    """Line and column, from 1, of a key (or list entry) and of its value; blank: nothing is written behind the key."""

    key: tuple[int, int]
    value: tuple[int, int]
    blank: bool = False


@dataclass(frozen=True)
class Document:
    """JSON data, and the position of every dotted key in the file ("" is the whole file)."""

    data: Any
    marks: Mapping[str, Mark]


class YamlProblem(Exception):
    """Fault in the text of a config, with its line and column from 1 and its dotted key."""

    def __init__(self, what: str, line: int, column: int, key: str = "", remedy: str = ""):
        super().__init__(what)
        self.what, self.line, self.column, self.key, self.remedy = what, line, column, key, remedy


def parse(text: str) -> Document:
    """Parse the document into mappings, lists, strings, numbers, booleans and null, as in JSON.

    Numbers follow YAML 1.2 ("1e11" is a number, "yes" is text). Raises YamlProblem for anything JSON cannot represent."""
    try:
        root = YAML(typ="safe", pure=True).compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        words = str(error.problem or error.context or "the text cannot be parsed")
        remedy = next((remedy for pattern, remedy in REMEDIES if re.search(pattern, words)), "")
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise YamlProblem(f"not valid YAML: {words}", line, column, remedy=remedy) from error
    except YAMLError as error:
        raise YamlProblem(f"not valid YAML: {' '.join(str(error).split())}", 1, 1) from error
    except RecursionError as error:
        raise YamlProblem("the mappings and lists are nested too deeply", 1, 1, remedy="close every bracket") from error
    if root is None:
        return Document(None, {"": Mark((1, 1), (1, 1))})
    marks: dict[str, Mark] = {"": Mark(_at(root), _at(root))}
    return Document(_json(root, "", marks), marks)


def _at(node: Any) -> tuple[int, int]:
    return node.start_mark.line + 1, node.start_mark.column + 1


def _json(node: Any, path: str, marks: dict[str, Mark]) -> Any:
    if getattr(node, "anchor", None):
        raise YamlProblem(
            "anchors (&) and aliases (*) are not supported", *_at(node), path, "write the value instead of every alias"
        )
    kind = str(node.tag).removeprefix(PREFIX)
    match node:
        case MappingNode() if kind == "map":
            return _mapping(node, path, marks)
        case SequenceNode() if kind == "seq":
            values = []
            for i, item in enumerate(node.value):
                below = f"{path}.{i}" if path else str(i)
                marks[below] = Mark(_at(item), _at(item))
                values.append(_json(item, below, marks))
            return values
        case ScalarNode():
            return _scalar(node, kind, path)
    raise YamlProblem(
        f"the YAML tag {node.tag} is not supported", *_at(node), path, "use plain text, numbers, lists or mappings"
    )


def _mapping(node: Any, path: str, marks: dict[str, Mark]) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, ScalarNode) or str(key_node.tag) == PREFIX + "merge" or key_node.anchor:
            raise YamlProblem("a key has to be plain text", *_at(key_node), path, "write KEY: VALUE")
        key = _text(key_node, path)
        below = f"{path}.{key}" if path else key
        if key in mapping:
            first = ":".join(map(str, marks[below].key))
            raise YamlProblem(
                "the key appears twice",
                *_at(key_node),
                below,
                f"remove one of the two keys; the first key is at {first} (line:column)",
            )
        # {0,01} has a key 01 without a colon
        behind = bool(value_node.start_mark.index > key_node.end_mark.index)
        marks[below] = Mark(_at(key_node), _at(value_node), value_node.value == "" and not value_node.style and behind)
        mapping[key] = _json(value_node, below, marks)
    return mapping


def _text(node: Any, path: str) -> str:
    """Text of a scalar. JSON escapes characters beyond U+FFFF as two surrogates, which the parser does not combine."""
    try:
        return str(node.value).encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError:
        raise YamlProblem(
            "the text contains an incomplete Unicode escape (half of a surrogate pair)",
            *_at(node),
            path,
            "write the character itself instead of its escape (\\u…)",
        ) from None


def _scalar(node: Any, kind: str, path: str) -> Any:
    text = _text(node, path)
    match kind:
        case "null":
            return None
        case "bool" if text in BOOLEANS:
            return BOOLEANS[text]
        case "int" if INTEGER.match(text) and len(text) <= 30:
            return int(text)
        case "int" | "float":
            return _float(text, node, path)
        case "str" | "timestamp":
            return text
    raise YamlProblem(
        f"the YAML tag {node.tag} is not supported", *_at(node), path, "use plain text, numbers, lists or mappings"
    )


def _float(text: str, node: Any, path: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0:
        raise YamlProblem(f"{text} is not a decimal number", *_at(node), path, "use the form 1890 or 1.89e3")
    return value
