"""SymPy vocabulary of the derivations: functions, vectors, rotations, and proved entries.

A derivation of one's own needs :class:`Derivation`, :func:`equal` and SymPy; see
:mod:`rodgen.symbolic.derivation` for an example.
"""

from rodgen.symbolic._errata import errata
from rodgen.symbolic.derivation import Derivation, DerivationError, Entry, Refutation, SymbolRow, equal
from rodgen.symbolic.functions import EPS, LARGEST, power_of_two_scale, select
from rodgen.symbolic.notebook import in_notebook
from rodgen.symbolic.reduction import remainder
from rodgen.symbolic.rotations import matrix_from_axis_angle, matrix_from_rodrigues_vector, rodrigues
from rodgen.symbolic.vectors import Letter, Vector, cross, dot, explicit, formal_determinant, norm, skew

__all__ = [
    "EPS",
    "LARGEST",
    "Derivation",
    "DerivationError",
    "Entry",
    "Letter",
    "Refutation",
    "SymbolRow",
    "Vector",
    "cross",
    "dot",
    "equal",
    "errata",
    "explicit",
    "formal_determinant",
    "in_notebook",
    "matrix_from_axis_angle",
    "matrix_from_rodrigues_vector",
    "norm",
    "power_of_two_scale",
    "remainder",
    "rodrigues",
    "select",
    "skew",
]
