"""What the data determine of the parameters, and what readings would determine the rest."""

from rodgen.calibration.determinacy.determinacy import Determinacy, Direction, determinacy

__all__ = ["Determinacy", "Direction", "determinacy"]
