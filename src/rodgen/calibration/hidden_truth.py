"""A truth that is told to nobody who does not ask: what is hidden in made-up data, in a file of its own."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Mapping
from typing import Any

from rodgen.errors import InputFileError

__all__ = ["opened", "sealed"]

NOTE = "What is hidden in the data. Open it when you have your answer: rodgen simulate --open TRUTH.json"
LARGEST_TRUTH = 1_000_000


def sealed(truth: Mapping[str, Any]) -> str:
    """Return a truth as the text of a file that tells nothing at a glance.

    It keeps eyes out, not thieves: base64 of JSON.

    Examples
    --------
    >>> "backlash" in sealed({"effects": ["backlash at C"]})
    False
    """
    content = base64.b64encode(json.dumps(truth, allow_nan=False).encode()).decode("ascii")
    return json.dumps({"note": NOTE, "sealed": content}, indent=2) + "\n"


def opened(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a sealed truth.

    Raises
    ------
    InputFileError
        When the file is none.
    """
    file = os.fspath(path)
    expected = "a file that 'rodgen simulate --truth' wrote"
    try:
        with open(file, "rb") as stream:
            content = stream.read(LARGEST_TRUTH)
    except OSError as error:
        found = (
            "no such file" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        )
        raise InputFileError(file, "file", found, expected) from None
    try:
        truth = json.loads(base64.b64decode(json.loads(content)["sealed"], validate=True))
        if not isinstance(truth["effects"], list):
            raise TypeError
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputFileError(file, "file", "no sealed truth", expected) from None
    return dict(truth)
