"""stub"""
from dataclasses import dataclass
@dataclass(frozen=True)
class Outside:
    kept: list
    forms: tuple
def outside_of(carriers, correlation, selection, residual, total, chosen):
    return Outside(list(chosen), ())
