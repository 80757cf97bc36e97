"""Documents: what a terminal and a page show is the same, and its numbers are those of the JSON."""

from __future__ import annotations

import html
import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from made_diagnoses import HOSTILE, mount, table

from rodgen.document import Bullets, Code, Document, Facts, Paragraph, Part, Table

WHOLE = Document(
    [
        Paragraph("The error falls by -2 um."),
        Part(
            [
                Facts([("a", "1.5 ± 0.2 arcsec"), ("Unusual", ""), ("a long name indeed", "seen")]),
                Table(("rms", "fitted", "odds"), [("file", "10.25", ""), ("+ b", "2.5", "30")], "lrl"),
                Table(("name",), [(str(n),) for n in range(5)], most=3, more="more"),
            ],
            "b at C",
            "effect",
        ),
        Part([Bullets(["One.", "Two."]), Code("a = -1\nb = 2")]),
    ],
    "Machine",
)
TEXT = """\
Machine
The error falls by -2 um.

b at C
  a            1.5 ± 0.2 arcsec
  a long name indeed seen
rms   fitted  odds
file   10.25
+ b      2.5  30
name
0
1
2
  and 2 more

  One.
  Two.
    a = -1
    b = 2"""


def words_of(page: str) -> list[str]:
    """The words that HTML shows."""
    return html.unescape(re.sub(r"<[^>]*>", " ", page)).replace("−", "-").replace("µm", "um").split()


def test_document_as_text():
    assert str(WHOLE) == TEXT


def test_page_shows_each_word_of_the_text_and_the_rows_that_it_does_not_have():
    shown = Counter(words_of(WHOLE._repr_html_()))
    assert Counter(TEXT.split()) - shown == Counter(["and"])
    assert shown - Counter(TEXT.split()) == Counter(["3", "4", "name"])


def test_names_of_a_user_are_text():
    blocks = [
        Paragraph(HOSTILE), Facts([(HOSTILE, HOSTILE)], HOSTILE), Table((HOSTILE,) * 6, [(HOSTILE,) * 6], "b", HOSTILE),
        Bullets([HOSTILE]), Code(HOSTILE, HOSTILE), Part([Paragraph(HOSTILE)], HOSTILE, "section"),
    ]  # fmt: skip
    assert "<img" not in Document(blocks, HOSTILE)._repr_html_()


# numbers -------------------------------------------------------------------------------------------------------------

NUMBER = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?(?:e-?\d+)?) (um|mm|arcsec|rad|1/K)(?![\w/])")


def numbers_in(data: Any) -> Iterator[float]:
    """All numbers of plain data."""
    if isinstance(data, dict):
        data = list(data.values())
    if isinstance(data, list):
        for part in data:
            yield from numbers_in(part)
    elif isinstance(data, float | int):
        yield float(data)


@pytest.mark.parametrize("found", [mount, table], ids=["mount", "table"])
def test_numbers_of_page_and_text_are_those_of_the_json(found):
    """Each number with a unit, in the digits that it has; those of the catalogue's own words are not measured."""
    diagnosis = found()
    catalogue = " ".join(
        text
        for s in diagnosis.steps
        for text in (s.meaning, s.effect.definition.usual_size, s.effect.definition.remedy)
    )
    for result, known in ((diagnosis, catalogue.replace("µm", "um")), (diagnosis.final, "")):
        text, data = str(result.document()), json.loads(json.dumps(result.to_dict()))
        page = " ".join(words_of(result._repr_html_()))
        said = set(NUMBER.findall(page)) - set(NUMBER.findall(known))
        assert len(said) > 3
        assert said <= set(NUMBER.findall(" ".join(text.split()).replace("µm", "um")))
        factors = {
            "um": (1.0, 1e3), "mm": (1.0,), "arcsec": (1.0,), "rad": (1.0,), "1/K": (1.0,),
        }  # fmt: skip
        for number, unit in said:
            digits = len(number.partition(".")[2])
            near = [
                f"{sign * value * factor:.{digits}f}"
                for value in numbers_in(data)
                for factor in factors[unit]
                for sign in (1, -1)
            ]
            assert number in near, (number, unit)
