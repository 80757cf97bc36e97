"""One rule for every effect that a diagnosis reports: full fits confirm it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hidden_effects import hidden

import rodgen
from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.diagnose import diagnose, search
from rodgen.calibration.diagnose.acceptance import why_not_earned
from rodgen.calibration.fitted import Estimate


def why(*, converged=True, before=2.0, after=1.0, stds=(0.1, None), held=False, log10_p=-5.0):
    fit = SimpleNamespace(solution=SimpleNamespace(converged=converged), unit="mm")
    held_out = tuple(HeldOut(rms, "mm", 10, 10) for rms in (before, after))
    estimates = {str(i): Estimate(str(i), "mm", 1.0, std, held, True) for i, std in enumerate(stds)}
    return why_not_earned(fit, held_out, estimates, log10_p)


@pytest.mark.parametrize(
    ("case", "reason"),
    [
        ({}, ""),
        ({"converged": False}, "does not converge"),
        ({"before": 79.0, "after": 80.6}, "does not fall with it (79 before, 80.6 mm after)"),
        ({"before": None, "after": None}, ""),
        ({"stds": (None, None)}, "do not determine its size"),
        ({"stds": (None, None), "held": True}, ""),
        ({"log10_p": -0.02}, "chance explains as much (p = 0.95)"),
    ],
)
def test_why_an_effect_is_not_reported(case, reason):
    assert reason in why(**case)
    assert bool(why(**case)) == bool(reason)


def test_the_search_goes_on_without_an_effect_that_full_fits_do_not_confirm(tmp_path, monkeypatch):
    machine, data = hidden("rotary_table", 11, [("backlash", "C")], raises=1.5).write(tmp_path)
    machine, data = rodgen.Machine.load(machine), rodgen.Measurements.load(data)
    first = diagnose(machine, data)
    assert [step.effect.title for step in first.steps] == ["backlash at C"]

    def refuse(after, *_):
        return "a reason" if any(e.name == "backlash" for e in after.machine.effects) else ""

    monkeypatch.setattr(search, "why_not_earned", refuse)
    found = diagnose(machine, data)
    named = {e.title for s in found.steps for e in (s.effect, *(a.effect for a in s.indistinguishable_from))}
    assert "backlash at C" not in named
    assert "Backlash at C is not reported: a reason." in found.notes
    # it was seen, and is ranked as before
    assert found.ranking[0].effect.title == "backlash at C"
