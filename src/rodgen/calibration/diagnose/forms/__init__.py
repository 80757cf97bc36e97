"""Which form has what no effect of the catalogue explains."""

from rodgen.calibration.diagnose.forms.formula import Form
from rodgen.calibration.diagnose.forms.search import find_forms

__all__ = ["Form", "find_forms"]
