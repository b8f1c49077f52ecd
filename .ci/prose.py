"""Check the prose of the project: forbidden words, sentences over 30 words, long lines and paragraphs of the manual, vague names.

Usage: prose.py [--changed] [--count | --list | --sample N [--seed S]] [PREFIX …]

    (none)      print `file:line: problem` for each problem and exit with 1 if there is one
    PREFIX      read only files whose path begins with it
    --changed   read only files changed by the last commit or since
    --count     print the number of problems by rule and by package
    --list      print every sentence that a user can meet, as `file:line: text`
    --sample    print N of them, drawn at random; parts that begin or end inside a sentence are left out

Read are the manual, and of pipeline/ and cli/ docstrings, comments, messages, help and page texts; of tests only their names.
The forbidden words are in words.toml.
"""

import argparse
import ast
import io
import random
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORDS = Path(__file__).with_name("words.toml")
GENERATED = ("docs/config/", "docs/history/", "docs/api/")
LAYOUT = r"(upper|lower|outside|center|best) (left|right|upper|lower|center).*|tight|-"
LONGEST_SENTENCE = 30
LONGEST_LINE = 120
LONGEST_PARAGRAPH = 5
PART = re.compile(r"\[?[,;:()].*|.*[,:(]")
SENTENCE_END = re.compile(r"(?<=[.!?…])[)\"'*_`]*\s+(?=[\"'(*_`\[]*[A-ZΑ-Ωσλφ0-9{])")
ABBREVIATIONS = re.compile(r"\b(e\.g|i\.e|cf|vs|etc|eq|Eq|Fig|fig|approx|no|No|al|ch|sec|p|pp|Dr|St)\.(?=\s)")


def sentences(text):
    """The sentences of a paragraph."""
    text = ABBREVIATIONS.sub(r"\1․", " ".join(text.split()))
    return [part for part in SENTENCE_END.split(text) if part]


def count_words(sentence):
    """Number of words of a sentence without formulas, values and code in backticks."""
    sentence = re.sub(r"`[^`]*`|\$[^$]*\$|\{[^}]*\}", "", sentence)
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


# -- forbidden words


@cache
def lists():
    return tomllib.loads(WORDS.read_text(encoding="utf-8"))


@cache
def forbidden():
    """(pattern, exceptions, replacement, whether names are read) of each forbidden word; a space is any white space."""
    entries = []
    for entry in lists()["entry"]:
        word = entry["word"].replace(" ", r"\s+")
        exceptions = re.compile("|".join(entry.get("except", [])) or r"(?!)")
        pattern = re.compile(rf"(?<!\w)(?:{word})(?!\w)", re.IGNORECASE)
        entries.append((pattern, exceptions, entry["write"], entry.get("names", False)))
    return entries


@cache
def any_forbidden():
    return re.compile("|".join(f"(?:{word.pattern})" for word, *_ in forbidden()), re.IGNORECASE)


@cache
def words_in(text, is_name):
    """(offset, message) of each forbidden word of a text."""
    if not any_forbidden().search(text):
        return ()
    return tuple(
        (hit.start(), f"'{' '.join(hit[0].split())}' → {write}")
        for word, exceptions, write, names in forbidden()
        for hit in (word.finditer(text) if names or not is_name else ())
        if not any(
            start <= hit.start() and hit.end() <= end for start, end in map(re.Match.span, exceptions.finditer(text))
        )
    )


# -- Python source


@cache
def split_name(name):
    """`aName_of` as "a Name of"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_+", " ", name).strip()


def joined(node, texts={}):  # noqa: B006  # never changed
    """The text of a string, f-string or local variable in `texts`, with {name} for each other value; None for other nodes."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(p.value if isinstance(p, ast.Constant) else placeholder(p.value, texts) for p in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        parts = [joined(node.left, texts), joined(node.right, texts)]
        return "".join(part or "{…}" for part in parts) if any(parts) else None
    if isinstance(node, ast.IfExp):
        parts = [joined(node.body, texts), joined(node.orelse, texts)]
        return None if None in parts else f"[{'|'.join(parts)}]"
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
        return texts.get(node.id)
    return None


def placeholder(node, texts):
    """A value in an f-string: its text if it has one, else `{name}`."""
    text = joined(node, texts)
    while isinstance(node, (ast.Call, ast.Subscript, ast.Starred)):
        is_function = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
        node = node.args[0] if is_function else node.func if isinstance(node, ast.Call) else node.value
    return "{" + getattr(node, "attr", getattr(node, "id", "…")) + "}" if text is None else text


def strings(tree):
    """(docstrings and the comment strings below fields, other strings and f-strings) of a module: lists of nodes."""
    comments, others = [], []

    def walk(node):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            comments.append(node.value)
        elif joined(node) is not None:
            others.append(node)
        else:
            for child in ast.iter_child_nodes(node):
                walk(child)

    walk(tree)
    return comments, others


def is_sentence(text):
    """Whether a string is prose: three words or more, and no markup, regular expression or code."""
    text = re.sub(r"`[^`]*`|(?<![\w/])[\w*]+(\.[\w*]+)+(?![\w/])", "x", text)  # code and config keys
    text = re.sub(r"\{(\w+|…)\}", " x ", text)  # values
    if re.search(r"[<>\\]|\w\(|^\s*[#.@]|:\s*\{|;\s*$|=[\"']|^[^\[]*\w\|\w[^\[]*\w\|\w", text):
        return False
    return len(re.findall(r"(?<![\w/.-])[A-Za-z]{2,}(?![\w/-])", text)) >= 3


def entries(node, texts={}, key=""):  # noqa: B006  # never changed
    """(line, text) of what a reader meets together: a message with its remedy, a key with its description."""
    if isinstance(node, ast.FunctionDef):
        yield from in_order(node.body, {})
        return
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return
    if isinstance(node, ast.Raise) and "AssertionError" in ast.unparse(node):  # a fault of the program
        return
    is_call = isinstance(node, ast.Call)
    nodes = [*node.args, *(word.value for word in node.keywords)] if is_call else [node]
    parts = [" ".join(text.split()) for part in nodes if (text := joined(part, texts))]
    parts = [part for part in parts if not re.fullmatch(LAYOUT, part)]
    if any(map(is_sentence, parts)):
        yield node.lineno, " → ".join(filter(None, (key, *parts)))
        nodes = [part for part in nodes if joined(part, texts) is None] if is_call else []
    elif isinstance(node, ast.Dict):
        for name, value in zip(node.keys, node.values, strict=True):
            yield from entries(value, texts, (name and joined(name)) or "")
        return
    else:
        key = node.target.id if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) else ""
        nodes = list(ast.iter_child_nodes(node))
    for child in nodes:
        yield from entries(child, texts, key)


def in_order(statements, texts):
    """Entries of the statements of a function; texts: those of its local variables, as the statements set them."""
    for statement in statements:
        name = getattr(statement, "targets", [None])[0]
        bodies = [
            getattr(statement, part) for part in ("body", "orelse", "finalbody") if getattr(statement, part, None)
        ]
        bodies += [case.body for case in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ()))]
        if isinstance(statement, ast.Assign) and isinstance(name, ast.Name):
            if (text := joined(statement.value, texts)) is None:
                yield from entries(statement.value, texts)
                texts.pop(name.id, None)
            else:
                texts[name.id] = text
        elif not bodies or isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            yield from entries(statement, texts)
        else:
            for part in ast.iter_child_nodes(statement):
                if isinstance(part, ast.expr):
                    yield from entries(part, texts)
            ends = [] if getattr(statement, "orelse", None) else [dict(texts)]
            for body in bodies:
                branch = dict(texts)
                yield from in_order(body, branch)
                if not isinstance(body[-1], (ast.Return, ast.Raise, ast.Continue)):
                    ends.append(branch)
            for each in {name for end in ends for name in end}:
                found = list(dict.fromkeys(end.get(each) for end in ends))
                texts[each] = found[0] if len(found) == 1 else f"[{'|'.join(filter(None, found))}]"


def user_sentences():
    """(file, line, text) of every sentence that a user can meet: messages, remedies, help, headings, page texts."""
    for top in ("pipeline", "cli"):
        for path in sorted((ROOT / top).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            name = path.relative_to(ROOT).as_posix()
            for line, text in entries(tree):
                yield name, line, text
            if (
                "/config/" in name
            ):  # sections are printed in the schema and in the reference of the config, dataclasses are not
                for node in ast.walk(tree):
                    if isinstance(node, ast.ClassDef) and not node.decorator_list and (text := ast.get_docstring(node)):
                        yield name, node.lineno, " ".join(text.split())


def source_texts(path, text):
    """(line, text, whether it is a name) of comments, texts and names of Python source."""
    yield 1, split_name(path.stem), True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", None)):
            yield token.start[0], token.string, False
        elif token.type == tokenize.NAME:
            yield token.start[0], split_name(token.string), True


def source_problems(path, text):
    """(line, problem) of long sentences and vague names."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        is_name = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        name = node.id if is_name else node.arg if isinstance(node, ast.arg) else getattr(node, "name", None)
        if isinstance(name, str) and name.strip("_") in lists()["vague_names"]:
            yield node.lineno, f"'{name}' as a name → the field's term for its value"
    comments, others = strings(tree)
    for node in comments:
        for paragraph in re.split(r"\n\s*\n|\n(?=\s*[\w,.*| ]+ {2,}\S)|\n(?=\s*[-*\d] )", node.value):
            yield from long_sentences(node.lineno, paragraph)
    for node in others:
        if is_sentence(" ".join(joined(node).split())):
            yield from long_sentences(node.lineno, joined(node))


def long_sentences(line, paragraph):
    for sentence in sentences(paragraph):
        if (count := count_words(sentence)) > LONGEST_SENTENCE:
            yield line, f"sentence of {count} words: {sentence[:60]} …"


# -- Markdown


def blocks(text):
    """(line, kind, block) of the paragraphs, list items and table rows of a page; code, comments and formulas are left out."""
    text = re.sub(
        r"^(```+|~~~+).*?^\1|<!--.*?-->|^\$\$.*?\$\$",
        lambda hit: "\n" * hit[0].count("\n"),
        text,
        flags=re.DOTALL | re.MULTILINE,
    )
    start, held, kind = 0, [], "paragraph"
    for number, line in enumerate([*text.splitlines(), ""], start=1):
        item = re.match(r"\s*(?:[-*+]|\d+\.)\s+", line)
        row = line.lstrip().startswith("|")
        heading = line.startswith("#")
        if (not line.strip() or item or row or heading) and held:
            yield start, kind, "\n".join(held)
            held = []
        if row:
            for cell in line.strip().strip("|").split(" | "):
                yield number, "cell", cell
        elif line.strip() and not heading:
            if not held:
                start, kind = number, "item" if item else "paragraph"
            held.append(line[item.end() :] if item else line)


def page_problems(path, text):
    """(line, problem) of long lines, paragraphs and sentences of a page."""
    code = False
    for number, line in enumerate(text.splitlines(), start=1):
        code ^= line.startswith("```")
        if len(line) > LONGEST_LINE and not code and not re.match(r"\s*\||\[!?\[|!\[|<", line):
            yield number, f"line of {len(line)} characters"
    for number, kind, block in blocks(text):
        block = re.sub(r"\]\([^)]*\)", "]", block)
        yield from long_sentences(number, block)
        if kind != "cell" and (count := len(sentences(block))) > LONGEST_PARAGRAPH:
            yield number, f"paragraph of {count} sentences"


# -- files


def prose_of_page(path, text):
    """The text without code in backticks, which may name keys and datasets."""
    return [(1, re.sub(r"`[^`\n]*`", "", text), False)]


def whole(path, text):
    return [(1, text, False)]


def names_of_tests(path, text):
    """The name of a file of tests, and those of its tests, as text."""
    yield 1, split_name(path.stem), False
    for number, line in enumerate(text.splitlines(), start=1):
        if name := re.match(r"def (test_\w+)", line):
            yield number, split_name(name[1]), False


def no_problems(path, text):
    return ()


READERS = {
    "*.md": (prose_of_page, page_problems),
    "docs/**/*.md": (prose_of_page, page_problems),
    "pipeline/**/*.js": (whole, no_problems),
    "pipeline/**/*.py": (source_texts, source_problems),
    "cli/**/*.py": (source_texts, source_problems),
    "tests/**/test_*.py": (names_of_tests, no_problems),
}


def changed_files(root=ROOT):
    """Files changed by the last commit or since; None, which is all, without Git or if the rules have changed."""
    names = set()
    for command in ("diff --name-only --relative HEAD~1", "ls-files --others --exclude-standard"):
        done = subprocess.run(["git", *command.split()], cwd=root, capture_output=True, text=True)
        if done.returncode:
            return None
        names.update(done.stdout.splitlines())
    return None if {".ci/prose.py", ".ci/words.toml"} & names else names


def problems(root=ROOT, names=None, prefixes=("",)):
    """(file, line, problem) of the files `names`, or of all, whose path begins with one of `prefixes`, in order."""
    result = set()
    for pattern, (reader, checker) in READERS.items():
        for path in root.glob(pattern):
            name = path.relative_to(root).as_posix()
            if name.startswith(GENERATED) or not name.startswith(prefixes) or (names is not None and name not in names):
                continue
            content = path.read_text(encoding="utf-8")
            for first, text, is_name in reader(path, content):
                result |= {(name, first + text.count("\n", 0, at), message) for at, message in words_in(text, is_name)}
            result |= {(name, line, message) for line, message in checker(path, content)}
    return sorted(problem for problem in result if not is_contract(*problem))


def is_contract(name, line, message):
    """Whether a word is the name of a config key, dataset or summary number that this file contains."""
    word = re.match(r"'([^']+)'", message)
    return word is not None and name in lists()["contracts"].get(word[1].lower(), ())


def package(name):
    """`pipeline/strainsight/decks/x.py` → `decks`; other files by their first folder."""
    parts = name.split("/")
    return parts[2] if parts[0] == "pipeline" and len(parts) > 3 else parts[0]


def rule(message):
    return (
        re.sub(r"\d+|: .*", "", message)
        if message.startswith(("sentence", "line", "paragraph"))
        else message.split(" → ")[1]
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--changed", action="store_true")
    parser.add_argument("--count", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--sample", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("prefix", nargs="*")
    options = parser.parse_args()
    prefixes = tuple(options.prefix) or ("",)
    if options.list or options.sample:
        listed = [entry for entry in user_sentences() if entry[0].startswith(prefixes)]
        if options.sample:
            whole_texts = [entry for entry in listed if not PART.fullmatch(entry[2])]
            listed = random.Random(options.seed).sample(whole_texts, options.sample)
        for name, line, text in listed:
            print(f"{name}:{line}: {text}")
        return 0
    hits = problems(ROOT, changed_files() if options.changed else None, prefixes)
    if options.count:
        for by in (lambda hit: rule(hit[2]), lambda hit: package(hit[0])):
            for what, count in Counter(map(by, hits)).most_common():
                print(f"{count:6d}  {what}")
            print()
    else:
        for name, line, message in hits:
            print(f"{name}:{line}: {message}")
    print(f"prose: {len(hits)} problems in {len({name for name, *_ in hits})} files")
    return int(bool(hits))


if __name__ == "__main__":
    sys.exit(main())
