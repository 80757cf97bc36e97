"""Which form has what no effect of the catalogue explains."""

from rodgen.discrepancy.diagnose._unexplained._dictionary import unnameable
from rodgen.discrepancy.diagnose._unexplained._form import Form
from rodgen.discrepancy.diagnose._unexplained._search import Best, best_terms, find_forms

__all__ = ["Best", "Form", "best_terms", "find_forms", "unnameable"]
