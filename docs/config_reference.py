"""Writes the config reference, a page a kind and section of a config, from the models: every key, its type, default and meaning.

`python docs/config_reference.py FOLDER`; the build of the manual calls it. The pages are not kept in the repository.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from strainsight.config.template import config_schema

KINDS = {"placement": "PlacementConfig", "bench": "BenchConfig", "bearing": "BearingConfig", "suite": "SuiteConfig"}
WHAT = {
    "placement": "From a deck to a validated layout: [the stages](../stages/index.md).",
    "bench": "Bodies, joints and bearings in time: [the stages](../stages/bench/index.md).",
    "bearing": "A bearing alone.",
    "suite": "Several configs and one page about them: [suites](../stages/suites.md).",
}
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
NAMES = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "null"}


def pages() -> dict[str, str]:
    """The text of every page by its name, without ending."""
    definitions = config_schema()["$defs"]
    found = {}
    for kind, model in KINDS.items():
        own, sections = [], []
        for key, field in definitions[model]["properties"].items():
            (sections if inside(field, definitions) else own).append(key)
        lines = [f"# kind: {kind}", "", WHAT[kind], "", definitions[model].get("description", ""), ""]
        lines += table(definitions[model], definitions, "", only=own)
        lines += expert_part(table(definitions[model], definitions, "", only=own, expert=True))
        if sections:
            lines += ["", "| section | | |", "|---|---|---|"]
        for key in sections:
            field = definitions[model]["properties"][key]
            later = f"required from stage `{field['required_from']}`" if "required_from" in field else "may be left out"
            needed = "required" if key in definitions[model].get("required", []) else later
            lines.append(f"| [`{key}`]({kind}-{key}.md) | {needed} | {cell(meaning(field, definitions))} |")
            found[f"{kind}-{key}"] = section_page(kind, key, field, definitions)
        lines += ["", "```{toctree}", ":hidden:", *(f"{kind}-{key}" for key in sections), "```"] if sections else []
        found[kind] = "\n".join(lines) + "\n"
    found["index"] = "\n".join(
        [
            "# Config reference",
            "",
            "Written from the models that check a config, so it is what this version takes. `strainsight schema` prints the",
            "same as a [JSON Schema](../config.schema.json) for your editor. A key with a dot goes behind `--set` as it stands;",
            "`NAME` is a name that you give, `[]` an entry of a list. A number outside its plausible range is a warning.",
            "Keys that no example sets stand at the end of a page, under *Expert keys*.",
            "",
            "```{toctree}",
            *KINDS,
            "```",
            "",
        ]
    )
    return found


def section_page(kind: str, key: str, field: dict[str, Any], definitions: dict[str, Any]) -> str:
    """A page about one section and all that stands below it."""
    lines = [f"# {kind}: {key}", ""]
    if field.get("description"):
        lines += [text(field["description"]), ""]
    expert_keys = []
    for path, name in below(field, definitions, key):
        model = definitions[name]
        expert_keys += table(model, definitions, path, expert=True)[len(HEAD) * bool(expert_keys) :]
        if rows := table(model, definitions, path):
            lines += [f"## `{path}`" + (f" ({variant(model)})" if variant(model) else ""), ""]
            lines += [text(model.get("description", "")), "", *rows, ""]
    return "\n".join([*lines, *expert_part(expert_keys)])


def expert_part(rows: list[str]) -> list[str]:
    """A section of the keys that no shipped example sets; empty without any."""
    if not rows:
        return []
    return ["", "## Expert keys", "", "No example sets these keys, and most configs do without them.", "", *rows, ""]


def below(field: dict[str, Any], definitions: dict[str, Any], path: str, above: tuple[str, ...] = ()):
    """(path, model) of every mapping at and below a field, in the order of the keys."""
    for name, suffix in inside(field, definitions):
        if name in above:
            continue
        yield path + suffix, name
        for key, entry in definitions[name].get("properties", {}).items():
            yield from below(entry, definitions, f"{path}{suffix}.{key}", (*above, name))


def inside(field: dict[str, Any], definitions: dict[str, Any], suffix: str = "") -> list[tuple[str, str]]:
    """(model, what its path ends with) of the mappings that a field may be."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[1]
        if definitions[name].get("properties"):
            return [(name, suffix)]
        return inside(definitions[name], definitions, suffix) if name != "JsonValue" else []
    found = [entry for option in options(field) for entry in inside(option, definitions, suffix)]
    if isinstance(field.get("items"), dict):
        found += inside(field["items"], definitions, suffix + "[]")
    for held in (field.get("additionalProperties"), *field.get("patternProperties", {}).values()):
        if isinstance(held, dict):
            found += inside(held, definitions, suffix + ".NAME")
    return list(dict.fromkeys(found))


HEAD = ["| key | type | default | what |", "|---|---|---|---|"]


def table(
    model: dict[str, Any], definitions: dict[str, Any], path: str, only: list[str] | None = None, expert: bool = False
) -> list[str]:
    """A line a key, of the expert keys or of the others; empty without any."""
    lines = []
    for key, field in model["properties"].items():
        if (only is None or key in only) and field.get("expert", False) == expert:
            full = f"{path}.{key}" if path else key
            default = "required" if key in model.get("required", []) else standard(field)
            which = f"`{variant(model)}`: " if expert and variant(model) else ""
            what = which + cell(meaning(field, definitions))
            if words := ranges(field):
                what += f" Plausible: {cell(words)}."
            lines.append(f"| `{full}` | {cell(kind_of(field, definitions))} | {default} | {what} |")
    return HEAD + lines if lines else []


def meaning(field: dict[str, Any], definitions: dict[str, Any]) -> str:
    """What is said of a field, or of the mapping that it is."""
    names = [name for name, _ in inside(field, definitions)]
    return field.get("description") or "; ".join(definitions[name].get("description", "") for name in names)


def kind_of(field: dict[str, Any], definitions: dict[str, Any]) -> str:
    """What may stand there, in words."""
    if "$ref" in field:
        name = field["$ref"].rsplit("/", 1)[1]
        if name == "JsonValue":
            return "anything"
        return "a mapping" if definitions[name].get("properties") else kind_of(definitions[name], definitions)
    if "const" in field:
        return f"`{json.dumps(field['const'], ensure_ascii=False)}`"
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    if options(field):
        return " or ".join(dict.fromkeys(kind_of(option, definitions) for option in options(field)))
    if field.get("type") == "array":
        if "prefixItems" in field:
            parts = [kind_of(item, definitions) for item in field["prefixItems"]]
            return f"list of {len(parts)}: {', '.join(dict.fromkeys(parts))}"
        return f"list of {kind_of(field.get('items', {}), definitions)}"
    if field.get("type") == "object":
        held = [field.get("additionalProperties"), *field.get("patternProperties", {}).values()]
        held = [kind_of(entry, definitions) for entry in held if isinstance(entry, dict)]
        return f"mapping of names to {' or '.join(held)}" if held else "a mapping"
    name = NAMES.get(field.get("type", ""), "anything")
    bounds = [f"{sign} {field[bound]:g}" for bound, sign in BOUNDS.items() if bound in field]
    return " ".join([name, ", ".join(bounds)]).strip()


def ranges(field: dict[str, Any]) -> str:
    """The plausible range of a field's numbers, in words."""
    if "plausible" in field:
        return field["plausible"]
    parts = [*options(field), *field.get("prefixItems", []), field.get("items"), field.get("additionalProperties")]
    return next((words for part in parts if isinstance(part, dict) and (words := ranges(part))), "")


def standard(field: dict[str, Any]) -> str:
    if "default" not in field:
        return "those of its keys"
    return f"`{json.dumps(field['default'], ensure_ascii=False)}`"


def options(field: dict[str, Any]) -> list[dict[str, Any]]:
    return field.get("anyOf", []) + field.get("oneOf", [])


def variant(model: dict[str, Any]) -> str:
    """`type: sine`: what tells the variants at one place apart."""
    tag = model["properties"].get("type", {})
    return f"type: {tag['const']}" if "const" in tag else ""


def text(words: str) -> str:
    """Plain words as Markdown."""
    for sign in "\\*_<>[]`$":
        words = words.replace(sign, "\\" + sign)
    return words


def cell(words: str) -> str:
    """Words for a cell of a table; code in backticks stays as it is."""
    parts = words.split("`")
    parts[::2] = [text(part) for part in parts[::2]]
    return "`".join(parts).replace("|", "\\|").replace("\n", " ")


def write(folder: Path) -> None:
    """Bring the pages in `folder` up to date; those that say the same are left alone."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {f"{name}.md": content for name, content in pages().items()}
    for path in folder.glob("*.md"):
        if path.name not in wanted:
            path.unlink()
    for name, content in wanted.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
