"""Documents: what a terminal and a page show is the same, and its numbers are those of the JSON."""

from __future__ import annotations

import json
import re
from collections import Counter

import pytest
from made_diagnoses import HOSTILE, MACHINES, mount, table
from shown_numbers import missing, numbers_in, numbers_of, words_of

from rodgen.calibration.check import check
from rodgen.calibration.compare import compare
from rodgen.calibration.plan.plan import plan
from rodgen.data.measurements import Measurements
from rodgen.document import Bullets, Code, Document, Facts, Paragraph, Part, Table
from rodgen.machines.machine import Machine
from rodgen.output.report import content, page

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
        shown = " ".join(words_of(result._repr_html_()))
        said = set(NUMBER.findall(shown)) - set(NUMBER.findall(known))
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


def compared():
    folder = MACHINES.parent / "off_by_20_um"
    return compare(Machine.load(folder / "machine.toml").fit(Measurements.load(folder / "data.csv")))


def checked():
    folder = MACHINES.parents[1] / "answers/field/angle_of_one_axis"
    return check(
        Machine.load(folder / "machine.toml"), Measurements.load(folder / "reversed_350_degrees.csv")
    )


RESULTS = {
    "check": checked,
    "comparison": compared,
    "plan of a table": lambda: plan(table().final, 4),
    "plan of a mount": lambda: plan(mount().base, 6),
    "fit": lambda: table().final,
}


@pytest.mark.thorough("check", "fit", "plan of a mount")
@pytest.mark.parametrize("of", RESULTS)
def test_each_number_of_a_page_stands_in_the_text_and_in_the_json(of):
    found = RESULTS[of]()
    shown = numbers_of(" ".join(words_of(found._repr_html_())))
    assert len(shown) > 2
    assert shown <= numbers_of(str(found.document()))
    assert missing(shown, json.loads(json.dumps(found.to_dict()))) == set()


@pytest.mark.thorough
def test_each_number_of_the_report_stands_in_its_text_its_json_and_that_of_the_diagnosis(
    monkeypatch, tmp_path
):
    """The JSON of a diagnosis lacks places, residuals and sizes on the machine, of which it has the parameters."""
    said = []
    monkeypatch.setattr(page, "report", lambda *given: said.append(content.report(*given)) or said[0])
    diagnosis, planned = table(), plan(table().final, 4)
    shown = numbers_of(" ".join(words_of(page.report_page(diagnosis, planned))))
    assert len(shown) > 50
    assert shown <= numbers_of(str(said[0]))
    page.write_report(diagnosis, tmp_path / "report.json", planned)
    whole = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert missing(shown, whole) == set()
    data = json.loads(json.dumps([diagnosis.to_dict(), diagnosis.final.to_dict(), planned.to_dict()]))
    sections = [block for block in said[0].blocks if isinstance(block, Part)]
    checked = [block for block in said[0].blocks if isinstance(block, Facts)]  # sizes, in large type
    checked += [
        s for s in sections if "verdict" in s.kind or s.title in ("What could hide", "What to measure next")
    ]
    (both,) = [s for s in sections if s.kind == "two"]
    checked += [part for part in both.blocks if part.title == "The error, model by model"]
    assert len(checked) > 3
    assert missing(numbers_of(str(Document(checked))), data) == set()
