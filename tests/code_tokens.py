"""The code in emitted text, without what only people read, and texts that users may give for names and meanings."""

import ast
import re

from hypothesis import strategies as st

ANY_NAME = st.text(
    st.one_of(st.sampled_from("*/\\?\"'#%{}\n\r\t \u2028\u202e"), st.characters(exclude_categories=["Cs"])),
    min_size=1,
)
PARTS = {
    "c": r'(?P<comment>/\*.*?\*/|//[^\n]*)|(?P<text>"""(?:[^"\\]|"(?!""))*"""|"(?:[^"\\\n]|\\.)*")',
    "matlab": r"(?P<comment>%[^\n]*|\.\.\.[^\n]*)|(?P<text>(?<![\w)\]}.'])'(?:[^'\n]|'')*'|\"(?:[^\"\n]|\"\")*\")",
}
"""Comments and texts of a language and those like it; what else has a quote there is the transposed of something."""


def code_of(text: str, language: str) -> str:
    """Return the code of a file without what only people read; a text that would end a line or a comment changes it."""

    def left(found: re.Match[str]) -> str:
        if found["text"]:
            return '""'
        assert not re.search(r"\\\n|\?\?/|\n\s*%[{}]\s*\n", found["comment"])
        return " "

    return " ".join(re.sub(PARTS[language], left, text, flags=re.DOTALL).split())


def python_code(text: str) -> str:
    """Return the tree of Python without what stands in texts."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.dump(tree)
