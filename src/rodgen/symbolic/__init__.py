"""SymPy vocabulary of the derivations: functions, vectors, rotations, and proved entries."""

from rodgen.symbolic.functions import EPS, power_of_two_scale, select

__all__ = ["EPS", "power_of_two_scale", "select"]
