"""Whether a machine file and its data are plausible, before anything is explained by them."""

from rodgen.calibration.file_check.search import Check, Mend, check

__all__ = ["Check", "Mend", "check"]
