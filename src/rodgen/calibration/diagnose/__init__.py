"""Which physical effect is missing in a machine's model, and how far to believe it."""

from rodgen.calibration.diagnose.diagnosis import Alias, DiagnosedEffect, Diagnosis, Ranked, Rms, Unexplained
from rodgen.calibration.diagnose.search import diagnose

__all__ = ["Alias", "DiagnosedEffect", "Diagnosis", "Ranked", "Rms", "Unexplained", "diagnose"]
