"""Compare the residuals of a fit with everything that was recorded: where the model is worst, and why."""

from rodgen.calibration.compare.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
