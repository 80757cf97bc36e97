"""Numbers and names as a sentence or a figure shows them."""

from __future__ import annotations

import math

from rodgen.data.units import readable
from rodgen.statistics.digits import last_decimal
from rodgen.statistics.thresholds import SMALLEST_P

SMALL_FALL = 0.1
"""Part of an error: a smaller fall is given in percent, too, and in digits that show it."""
DIGITS_OF_P = 1e-4
"""A smaller p-value is shown as the power of ten above it."""
LEAST_P = 16
"""No p-value is shown as smaller than 10 to the minus this: errors of readings have no normal tails so far out."""
EQUAL_ODDS = 3.0
"""Odds, to 1, that are smaller are called equal: not worth more than a bare mention (Kass and Raftery 1995)."""
MOST_ODDS = 1e6
"""Odds beyond which a number says nothing more: the model itself is not that sure."""
LEAST_ODDS = 0.001
NAMES = 4
"""Names in a list that is not the point of its sentence; the others are counted."""
IN_UNCERTAINTIES = "stated uncertainties"
"""The unit of weighted residuals."""
UNWEIGHED = (
    "The fit weighs readings by the error that those of a pose share. These plain errors do not, so that they may rise "
    "with an effect that is there."
)
NOTHING_LEFT = (
    "There are no more readings than parameters that they determine: the model goes through them, "
    "right or wrong."
)


def fall(before: float, after: float, unit: str) -> str:
    """Return how an error falls, in digits that show it; a small fall in percent, too.

    Examples
    --------
    >>> fall(0.00321, 0.00108, "mm"), fall(2.9312, 2.8992, "mm")
    ('falls from 3.21 to 1.08 um', 'falls by 1.1 %, from 2.931 to 2.899 mm')
    >>> fall(0.00108, 0.00109, "mm")
    'stays at 1.08 um'
    """
    factor, unit = readable(unit, before)
    before, after = before * factor, after * factor
    part = 1 - after / before if before > 0 else 0.0
    if not part > 0:
        return f"stays at {three_digits(before)} {unit}"
    if part >= SMALL_FALL:
        return f"falls from {three_digits(before)} to {three_digits(after)} {unit}"
    digits = 2 - math.floor(math.log10(part))
    share = f"{100 * part:.2g} %"
    return f"falls by {share}, from {before:.{digits}g} to {after:.{digits}g} {unit}"


def in_component(name: str) -> str:
    """Return where a component of a residual points.

    Examples
    --------
    >>> in_component("x"), in_component("zenith")
    ('in x', 'towards the zenith')
    """
    return {"horizontal": "horizontally", "zenith": "towards the zenith"}.get(name, f"in {name}")


def sized(value: float, unit: str, spec: str = "") -> str:
    """Return an error in the unit in which people read it, with three digits or as a format says.

    Examples
    --------
    >>> sized(0.00321, "mm"), sized(1.5, "arcsec"), sized(-0.0032, "mm", "+.3g")
    ('3.21 um', '1.50 arcsec', '-3.2 um')
    """
    factor, unit = readable(unit, value)
    return f"{format(value * factor, spec) if spec else three_digits(value * factor)} {unit}"


def three_digits(value: float) -> str:
    """Return a number with three digits, without an exponent where that is readable.

    Examples
    --------
    >>> three_digits(0.2), three_digits(0.9996), three_digits(1234.5), three_digits(2e-7)
    ('0.200', '1.00', '1234', '2e-07')
    """
    return _with_digits(value, 3)


def two_digits(value: float) -> str:
    """Return a number rounded to two digits, without an exponent where that is readable.

    Examples
    --------
    >>> two_digits(0.2), two_digits(134.5), two_digits(99.6), two_digits(2e-7)
    ('0.20', '130', '100', '2e-07')
    """
    rounded = float(f"{value:.1e}")
    return _with_digits(rounded, 2)


def _with_digits(value: float, count: int) -> str:
    if value == 0 or 1e-5 <= abs(value) < 1e6:
        decimals = int(last_decimal(abs(value), count)) if value else 0
        return f"{value:.{max(decimals, 0)}f}"
    return f"{value:.{count}g}"


def percent(part: float, least: float = 0.1) -> str:
    """Return a part of a whole, or a probability; of what is nearer to 0 or 1 than `least` per cent, only that it is.

    Examples
    --------
    >>> percent(0.934), percent(0.0004), percent(0.012), percent(1.0), percent(0.9997)
    ('93 %', '< 0.1 %', '1.2 %', '100 %', '> 99.9 %')
    >>> percent(0.0051, 1), percent(0.0449, 1), percent(0.998, 1)
    ('< 1 %', '4 %', '> 99 %')
    """
    hundreds = 100 * min(max(part, 0.0), 1.0)
    near = min(hundreds, 100 - hundreds)
    if 0 < near < least:
        return f"< {least:g} %" if hundreds < 50 else f"> {100 - least:g} %"
    digits = least < 1 and near > 0 and (hundreds < 9.95 or near < 1)
    return f"{hundreds:.{int(digits)}f} %"


def odds_text(times: float) -> str:
    """Return how many times as probable something is, in two digits, from a thousandth to a million.

    Examples
    --------
    >>> odds_text(4.86), odds_text(17_342.0), odds_text(1e-5), odds_text(1e9)
    ('4.9', '17 000', 'less than 0.001', 'more than a million')
    """
    if times >= MOST_ODDS:
        return "more than a million"
    if times < LEAST_ODDS:
        return f"less than {LEAST_ODDS}"
    return two_digits(times) if times < 1000 else f"{float(f'{times:.1e}'):,.0f}".replace(",", " ")


def chance(p: float) -> str:
    """Return a p-value as a sentence shows it.

    Examples
    --------
    >>> chance(0.0312), chance(0.0)
    ('p = 0.031', 'p < 1e-16')
    """
    text = probability(p)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def probability(p: float) -> str:
    """Return a p-value as a table shows it: no more of it than the tails of real errors are known.

    Examples
    --------
    >>> probability(0.0312), probability(0.00042), probability(3e-7), probability(1e-80)
    ('0.031', '0.00042', '< 1e-6', '< 1e-16')
    """
    if p >= DIGITS_OF_P:
        return f"{min(p, 1.0):.2g}"
    return f"< 1e-{min(math.floor(-math.log10(max(p, SMALLEST_P))), LEAST_P)}"


def comparison(odds: float, *, than: str = "") -> str:
    """Return odds in words, such as "50 times less probable", with what they are compared with."""
    times = max(odds, 1 / max(odds, 1e-300))
    if times < EQUAL_ODDS:
        return f"about as probable{than.replace(' than ', ' as ')}"
    return f"{odds_text(times)} times {'more' if odds > 1 else 'less'} probable{than}"


def capitalized(sentence: str) -> str:
    """Return a sentence with its first letter in upper case; the others, as of names, stay."""
    return sentence[:1].upper() + sentence[1:]


def uncapitalized(sentence: str) -> str:
    """Return a sentence with its first letter in lower case, to follow other words."""
    return sentence[:1].lower() + sentence[1:]


def plain(name: str, limit: int = 40) -> str:
    """Return a piece of a user's file on one line, and no longer than `limit`."""
    line = "".join(c if c.isprintable() else "?" for c in name)
    return line if len(line) <= limit else line[: limit - 1] + "…"
