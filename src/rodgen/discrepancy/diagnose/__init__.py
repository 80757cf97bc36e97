"""Which physical effect is missing in a machine's model, and how far to believe it."""

from rodgen.discrepancy.diagnose._diagnose import diagnose
from rodgen.discrepancy.diagnose._diagnosis import Alias, DiagnosedEffect, Diagnosis, Ranked, Rms, Unexplained

__all__ = ["Alias", "DiagnosedEffect", "Diagnosis", "Ranked", "Rms", "Unexplained", "diagnose"]
