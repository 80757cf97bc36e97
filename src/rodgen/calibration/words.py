"""Numbers and names as a sentence or a figure shows them."""

from __future__ import annotations

import math

__all__ = ["capitalized", "plain", "three_digits", "uncapitalized"]


def three_digits(value: float) -> str:
    """Return a number with three digits, without an exponent where that is readable.

    Examples
    --------
    >>> three_digits(0.2), three_digits(1234.5), three_digits(2e-7)
    ('0.200', '1234', '2e-07')
    """
    if value == 0 or 1e-5 <= abs(value) < 1e6:
        digits = 2 - math.floor(math.log10(abs(value))) if value else 0
        return f"{value:.{max(digits, 0)}f}"
    return f"{value:.3g}"


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
