"""Derivations that are executed when a test uses them, so that collecting the tests executes none."""

from __future__ import annotations

import importlib
from typing import Any


class LazyDerivation:
    """The module ``rodgen.derivation.NAME``, imported when one of its public names is first used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith(("_", "pytest_")):  # what pytest asks every object of a test module for
            raise AttributeError(attribute)
        return getattr(importlib.import_module(f"rodgen.derivation.{self._name}"), attribute)
