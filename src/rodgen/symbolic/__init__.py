"""SymPy vocabulary of the derivations: functions, vectors, rotations, and proved entries.

Your own derivation needs :class:`Derivation`, :func:`equal` and SymPy; see
:mod:`rodgen.symbolic.derivation` for an example.

A name is imported when it is first asked for: :mod:`rodgen.symbolic.rigid_motions` and :mod:`rodgen.symbolic.legs` need
no SymPy.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from rodgen.symbolic._errata import errata
    from rodgen.symbolic.derivation import Derivation, DerivationError, Entry, Refutation, SymbolRow, equal
    from rodgen.symbolic.display import in_notebook
    from rodgen.symbolic.dual import Dual, dual_matrix, dual_rotation_x, dual_rotation_z, dual_value
    from rodgen.symbolic.functions import EPS, LARGEST, Formulas, last_case, power_of_two_scale, select
    from rodgen.symbolic.reduction import factored, remainder
    from rodgen.symbolic.rotations import (
        coordinate_rotation,
        inverse_transform,
        matrix_from_axis_angle,
        matrix_from_rodrigues_vector,
        rodrigues,
        rot,
        transform,
    )
    from rodgen.symbolic.screws import (
        DELTA,
        ReciprocalSystem,
        axis_point,
        couple,
        line_along,
        line_of_planes,
        line_through,
        pitch,
        reciprocal_product,
        reciprocal_system,
        screw,
        screw_transform,
        self_product,
    )
    from rodgen.symbolic.vectors import Letter, Vector, cross, dot, explicit, formal_determinant, norm, skew

__all__ = [
    "DELTA",
    "EPS",
    "LARGEST",
    "Derivation",
    "DerivationError",
    "Dual",
    "Entry",
    "Formulas",
    "Letter",
    "ReciprocalSystem",
    "Refutation",
    "SymbolRow",
    "Vector",
    "axis_point",
    "coordinate_rotation",
    "couple",
    "cross",
    "dot",
    "dual_matrix",
    "dual_rotation_x",
    "dual_rotation_z",
    "dual_value",
    "equal",
    "errata",
    "explicit",
    "factored",
    "formal_determinant",
    "in_notebook",
    "inverse_transform",
    "last_case",
    "line_along",
    "line_of_planes",
    "line_through",
    "matrix_from_axis_angle",
    "matrix_from_rodrigues_vector",
    "norm",
    "pitch",
    "power_of_two_scale",
    "reciprocal_product",
    "reciprocal_system",
    "remainder",
    "rodrigues",
    "rot",
    "screw",
    "screw_transform",
    "select",
    "self_product",
    "skew",
    "transform",
]

_HOMES = (
    "functions",
    "vectors",
    "derivation",
    "rotations",
    "screws",
    "display",
    "dual",
    "reduction",
    "_errata",
)
"""Modules of these names, those that are asked most first."""


def __getattr__(name: str) -> _Any:
    if name in __all__:
        for home in _HOMES:
            module = _import_module(f"{__name__}.{home}")
            if name in vars(module):
                value = globals()[name] = vars(module)[name]
                return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
