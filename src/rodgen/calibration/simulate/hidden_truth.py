"""The truth behind simulated measurements, in a file of its own: plain JSON, to be read when the answer is there."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from rodgen.errors import InputFileError
from rodgen.files import read_input

TRUTH_FILE = "a file that 'rodgen simulate --truth' wrote"
NOTE = "What is hidden in the data. Read it when you have your answer: rodgen simulate --open TRUTH.json"


def truth_as_json(truth: Mapping[str, Any]) -> str:
    """Return a truth as the text of a JSON file.

    Examples
    --------
    >>> json.loads(truth_as_json({"effects": []}))["truth"]
    {'effects': []}
    """
    return json.dumps({"note": NOTE, "truth": truth}, indent=2, allow_nan=False) + "\n"


def read_truth(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the truth that a file holds.

    Raises
    ------
    InputFileError
        When the file holds none.
    """
    file = os.fspath(path)
    content = read_input(file, TRUTH_FILE)
    try:
        truth = json.loads(content)["truth"]
        if not isinstance(truth["effects"], list):
            raise TypeError
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputFileError(file, "file", "no truth of a simulation", TRUTH_FILE) from None
    return dict(truth)
