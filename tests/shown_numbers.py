"""Numbers that a page shows, and those of the text and the JSON of the same result."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from typing import Any

NUMBER = re.compile(r"(?<![\w.,])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w|\.\d)")
FACTORS = 1.0, 1e3, 1e2
"""From the data to what is shown: the same, mm to um, and a part to %."""


def words_of(page: str) -> list[str]:
    """The words that HTML shows."""
    page = re.sub(r"(?s)<(script|style|svg)\b.*?</\1>", " ", page)
    return html.unescape(re.sub(r"<[^>]*>", " ", page)).replace("−", "-").replace("µm", "um").split()


def leaves(data: Any) -> Iterator[Any]:
    """All numbers and texts of plain data, and how many parts each list and each dict has."""
    if isinstance(data, dict):
        yield from data
    if isinstance(data, dict | list):
        yield len(data)
        for part in data.values() if isinstance(data, dict) else data:
            yield from leaves(part)
    else:
        yield data


def numbers_in(data: Any) -> Iterator[float]:
    """All numbers of plain data, and how many parts it has."""
    return (float(leaf) for leaf in leaves(data) if isinstance(leaf, float | int))


def numbers_of(text: str) -> set[str]:
    """The numbers of a text, in the digits that it has."""
    return set(NUMBER.findall(" ".join(text.split()).replace("−", "-")))


def odds_in(data: Any) -> Iterator[str]:
    """Odds in two digits, which stand in the data as logarithms; each group of three digits by itself."""
    for part in data.values() if isinstance(data, dict) else data if isinstance(data, list) else ():
        yield from odds_in(part)
    found = data.get("log10_odds") if isinstance(data, dict) else None
    if isinstance(found, float):
        yield from f"{float(f'{10 ** abs(found):.1e}'):,.10g}".split(",")


def missing(numbers: set[str], data: Any) -> set[str]:
    """Those of the numbers that stand neither in a text of the data nor, rounded to as many digits, as a number."""
    said = numbers_of(" ".join(leaf for leaf in leaves(data) if isinstance(leaf, str)))
    values = list(numbers_in(data))

    def stands(number: str) -> bool:
        mantissa, e, _ = number.partition("e")
        form = f".{len(mantissa.partition('.')[2])}{e or 'f'}"
        near = (float(f"{value * factor:{form}}") for value in values for factor in FACTORS)
        return abs(float(number)) in map(abs, near)

    return {number for number in numbers - said - {*odds_in(data)} if not stands(number)}
