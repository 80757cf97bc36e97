"""Methods of a class whose implementation is in a module above it.

A machine is data, and a fit is a result: neither imports what reads, judges, draws or writes it. The class names such a
method here, and `rodgen.facade`, the top module, says which function it is. That function takes the object first.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MethodType
from typing import Any

_functions: dict[str, str] = {}


def implement(functions: Mapping[str, str]) -> None:
    """Say which function each method is: of ``CLASS.METHOD`` its ``MODULE.NAME``, imported at the first call."""
    _functions.update(functions)


def method(*, of_class: bool = False) -> Any:
    """Return a method that a module above implements; one of the class does not take an object."""
    return _Method(of_class=of_class)


def attribute() -> Any:
    """Return an attribute that a module above computes, once for each object."""
    return _Attribute()


class _Method:
    def __init__(self, *, of_class: bool = False) -> None:
        self.of_class = of_class

    def __set_name__(self, owner: type, name: str) -> None:
        self.key = f"{owner.__name__}.{name}"

    @property
    def function(self) -> Any:
        """The implementation."""
        module, _, name = _functions[self.key].rpartition(".")
        return getattr(import_module(module), name)

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self.function if instance is None or self.of_class else MethodType(self.function, instance)


class _Attribute(_Method):
    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return property(self.function)  # for help()
        name = self.key.partition(".")[2]
        value = instance.__dict__[name] = self.function(instance)
        return value
