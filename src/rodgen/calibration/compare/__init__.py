"""Hold the residuals of a fit against everything that was noted: where the model is worst, and what that is due to."""

from rodgen.calibration.compare.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
