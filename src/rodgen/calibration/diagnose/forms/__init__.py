"""Which form has what no effect of the catalogue explains."""

from rodgen.calibration.diagnose.forms.dictionary import unnameable
from rodgen.calibration.diagnose.forms.form import Form
from rodgen.calibration.diagnose.forms.search import Best, best_terms, find_forms

__all__ = ["Best", "Form", "best_terms", "find_forms", "unnameable"]
