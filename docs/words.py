"""How long sentences are, and which idioms are banned: ``python docs/words.py`` prints a table of the pages.

`make check` (tests/lints.py) calls the same functions. Code, tables and headings do not count.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs/site"))
from links import prose  # noqa: E402

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "benchmarks/README.md",
]
MOST_BYTES = 170_000
"""Of all pages under docs together."""
LINES = {ROOT / "docs/guides": 120}
"""Of a page in a folder, but for code."""
LONGEST, MEAN = 25, 16
"""Words of a sentence, and of the sentences of a page in the mean; a formula, a link or a piece of code is a word."""
BANNED = {
    r"all but (exactly|alone|a|an|the)\b": "nearly",
    r"in the place of": "instead of",
    r"less likely by": "times less probable",
    r"without its effects": "without the effects of the file",
    r"\bas they come\b": "one by one, or name the form",
    r"do(es)? the same to\b": "indistinguishable",
    r"\bgoes on (from|where)\b": "continues",
    r"\bstands? in\b(?! for)": "is in",
    r"\b(stands?|standing|stood) beside\b": "competes with, next to",
    r"\bbeside (it|them|the|this|that|each|these|those)\b": "next to",
    r"\bit is said\b": "rodgen reports",
    r"\b(is|are) said to be\b": "is reported as",
    r"\bthat there (is|are) not\b": "missing",
    r"\bas exact as\b": "to the precision of",
    r"\bheld against\b": "compared with",
    r"\bbrings? nothing\b": "does not help",
    r"\bwhat it was\b": "unchanged",
    r"\bpull the axis\b": "bias",
    r"\bkeeps? (its|their) promises?\b": "suffice as often as stated",
    r"\bhow far to believe\b": "how reliable",
    r"\bexplains? it not\b": "does not explain it",
    r"\band not falsely\b": "and false alarms are no more frequent",
    r"\bnothing tells\b": "there is no evidence",
}
"""Idioms that must be read twice, as patterns, and what to write instead."""


def sentences(page: str) -> Iterator[list[str]]:
    """Yield the words of each sentence of a Markdown text."""
    text = re.sub(r"<!--.*?-->", "", page, flags=re.DOTALL)
    lines = [
        line if is_prose and not re.match(r"#|\s*\||!\[", line) else "\n" for line, is_prose in prose(text)
    ]
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", "".join(lines)):
        flat = re.sub(r"``?[^`]+``?|\$[^$]+\$", "Code", " ".join(paragraph.split()))
        flat = re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", re.sub(r"^(?:[-*]|\d+\.) ", "", flat))
        for sentence in re.split(r"(?<=[.?!:])[*)\"]* (?=[^a-z])|(?<=[.?!])$", flat):
            if len(words := re.findall(r"\S*\w\S*", sentence)) > 2:
                yield words


def idioms(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield line, idiom and what to write instead, of each banned idiom in a text."""
    for pattern, instead in BANNED.items():
        for found in re.finditer(pattern.replace(" ", r"\s+"), text, re.IGNORECASE):
            yield text.count("\n", 0, found.start()) + 1, found[0], instead


def texts(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of the strings and comments of a module."""
    source = file.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def faults() -> list[str]:
    """Return what is wrong with pages and with the words of the package, a line each."""
    found, total = [], 0
    for page in PAGES:
        text, name = page.read_text(encoding="utf-8"), page.relative_to(ROOT)
        lengths = [len(words) for words in sentences(text)]
        lines = sum(is_prose for _, is_prose in prose(text))
        total += page.is_relative_to(ROOT / "docs") * len(text.encode())
        found += [f"{name}: a sentence of {n} words" for n in lengths if n > LONGEST]
        found += [f"{name}: sentences of {sum(lengths) / len(lengths):.1f} words"] * (
            sum(lengths) > MEAN * len(lengths)
        )
        found += [
            f"{name}, line {line}: {idiom!r}: write {instead!r}" for line, idiom, instead in idioms(text)
        ]
        lines = sum(is_prose for _, is_prose in prose(text))
        found += [f"{name}: {lines} lines"] * (lines > LINES.get(page.parent, 10**6))
    found += [f"docs: {total} bytes"] * (total > MOST_BYTES)
    for file in sorted((ROOT / "src").rglob("*.py")):
        for line, text in texts(file):
            for _, idiom, instead in idioms(text):
                found.append(f"{file.relative_to(ROOT)}, line {line}: {idiom!r}: write {instead!r}")
    return found


def main() -> None:
    """Print bytes, mean and longest sentence of each page, and its longest sentences with ``-v``."""
    total = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        lengths = sorted(map(len, sentences(text))) or [0]
        total += page.is_relative_to(ROOT / "docs") * len(text.encode())
        print(
            f"{page.relative_to(ROOT)!s:44} {len(text.encode()):6} {sum(lengths) / len(lengths):5.1f} {lengths[-1]:3}"
        )
        for words in sentences(text) if "-v" in sys.argv else ():
            if len(words) > LONGEST:
                print("   ", len(words), " ".join(words))
        for line, idiom, instead in idioms(text):
            print(f"    line {line}: {idiom!r}: write {instead!r}")
    print(f"{'docs':44} {total:6}")


if __name__ == "__main__":
    main()
