"""Names in measurements: of targets and of runs."""

from __future__ import annotations

import re

__all__ = ["plain_name"]


def plain_name(name: str) -> str:
    """Return a name so that a whole number is one name however it is written.

    A run that was noted as 1 reads 1.0 once a table of numbers has held it.

    Examples
    --------
    >>> plain_name("1.0"), plain_name("01"), plain_name("1.5"), plain_name("ball_1")
    ('1', '01', '1.5', 'ball_1')
    """
    whole = re.fullmatch(r"([+-]?\d+)\.0*", name)
    return whole[1] if whole else name
