"""Whether a machine file and its data are plausible, before anything is explained by them."""

from rodgen.calibration.check.search import Check, Mend, check
from rodgen.calibration.check.suspicion import implausible_numbers

__all__ = ["Check", "Mend", "check", "implausible_numbers"]
