"""The way from a fit to what is missing in its model.

Everything is decided on linear columns in one space (`_selection`), and everything that is told comes from full fits:
of the model as it was, with each effect that was found, and of what could stand in their place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.assembly_modes import in_another_mode, weakest
from rodgen.calibration.binding import bind
from rodgen.calibration.diagnose.aliases import aliases_of
from rodgen.calibration.diagnose.candidates import Candidate, candidates
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.column_space import Space
from rodgen.calibration.diagnose.correlation import Correlation, correlation
from rodgen.calibration.diagnose.diagnosis import (
    DiagnosedEffect,
    Diagnosis,
    Ranked,
    Rms,
    Unexplained,
)
from rodgen.calibration.diagnose.duplicate_rows import first_of_each
from rodgen.calibration.diagnose.estimates import Numbers
from rodgen.calibration.diagnose.forms import Form
from rodgen.calibration.diagnose.held_out_blocks import Blocks
from rodgen.calibration.diagnose.outliers import gross_errors, together
from rodgen.calibration.diagnose.selection import Selection
from rodgen.calibration.diagnose.sensitivities import Carriers, catalogue_effects
from rodgen.calibration.diagnose.uncatalogued import Outside, outside_of
from rodgen.calibration.diagnose.validation import error_on, further
from rodgen.calibration.diagnose.verdict import disagreement, in_order_of_time, jump
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.robust import gross_rows
from rodgen.calibration.staged_fit import FitError
from rodgen.data.measurements import Measurements
from rodgen.data.observations import Observations
from rodgen.errors import InputFileError
from rodgen.machines.machine import Machine
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.thresholds import EVIDENCE, SMALLEST_P, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

__all__ = ["diagnose"]

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Progress: TypeAlias = Callable[[str, int, float], object]

COMPILE_FROM = 20_000
"""From so many rows on compiling a model that is fitted once pays."""


def diagnose(
    fitted: Fit | Machine,
    data: Measurements | Observations | None = None,
    *,
    test: Measurements | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find out which physical effects are missing in a machine's model, from measurements alone.

    Parameters
    ----------
    fitted : Fit or Machine
        The model as it is: fitted, or to be fitted to `data`.
    data : Measurements or Observations, optional
        Needed with a machine.
    test : Measurements, optional
        Others, of which the error is told, too. Only the frame is fitted to them, where it is free.
    progress : callable, optional
        Called with what is done, a number and the cost.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputFileError
        When the data do not fit the machine.
    FitError
        When there is nothing to fit, or no data are given with a machine.
    """
    if isinstance(fitted, FittedModel):
        others = None if test is None else further(fitted.machine, test)
    else:
        if data is None:
            raise FitError("a machine without measurements; expected both, or a fit")
        observations = data if isinstance(data, Observations) else bind(fitted, data)
        others = None if test is None else further(fitted, test)  # what is wrong is told before a long fit
        fitted = fitted.fit(observations, progress=progress)
    with one_thread_in_blas():
        return _Diagnosing(fitted, others, progress).run()


@dataclass(eq=False)
class _Look:
    """A fit, and all candidates' columns there."""

    carriers: Carriers
    found: list[Candidate]

    @classmethod
    def at(cls, base: Fit) -> _Look:
        effects = catalogue_effects(base.machine, base.observations)
        carriers = Carriers.of(base, effects)
        return cls(carriers, candidates(carriers, effects))


@dataclass(eq=False)
class _Work:
    """What one look at the data rests on: the base fit without outliers, and the space of all columns."""

    base: Fit
    carriers: Carriers
    found: list[Candidate]
    correlation: Correlation
    space: Space
    selection: Selection
    residual: Array
    total: float
    chosen: list[Candidate] = field(default_factory=list)


class _Diagnosing:
    def __init__(self, fitted: Fit, others: Observations | None, progress: Progress | None) -> None:
        self.fitted, self.others, self.progress = fitted, others, progress
        self.notes: list[str] = []
        self.given = fitted.observations
        self.kept = first_of_each(self.given)
        if len(self.kept) < self.given.n:
            copies = self.given.n - len(self.kept)
            self.notes.append(f"{copies} rows are copies of others, readings and all; each counts once.")
            self.fitted = fitted.refit(
                observations=self.given.take(self.kept), outliers=fitted.outliers[self.kept]
            )
        self.observations = self.fitted.observations

    def tell(self, what: str) -> None:
        if self.progress is not None:
            self.progress(what, 0, self.fitted.chi_square)

    # the way -------------------------------------------------------------------------------------------------

    def run(self) -> Diagnosis:
        try:
            return self._run()
        except FitError:
            if not self.fitted.problem.is_closed_chain:
                raise
            return self._undecided(
                "With a further effect legs do not close any more: the geometry, or the order of the legs, is far from "
                "right."
            )

    def _run(self) -> Diagnosis:
        reason = self._cannot_tell(self.fitted)
        if reason:
            return self._undecided(reason)
        outliers = self.fitted.outliers
        look = _Look.at(self.fitted)
        if not outliers.any():
            outliers = self._gross(look)
        for last in (False, False, True):
            base = self.fitted
            if not np.array_equal(outliers, base.outliers):
                base = self._fit(self.fitted.machine, outliers)
                reason = self._cannot_tell(base)
                if reason:
                    return self._undecided(reason)
                look = _Look.at(base)
            work = self._work(base, look)
            work.chosen = work.selection.run(work.residual, work.total)
            fits = self._fits(work)
            outside = self._outside(work, fits[-1])
            if [c.key for c in outside.kept] != [c.key for c in work.chosen]:
                work.chosen = list(outside.kept)
                fits = self._fits(work)
            while unsure := self._unsure(work, fits[-1]):
                work.chosen.remove(unsure)
                outside = replace(outside, kept=tuple(work.chosen))
                fits = self._fits(work)
            formed = self._formed(fits[-1], outside.forms)
            again = outliers if last else self._judged(formed[-1][1] if formed else fits[-1], outliers)
            if np.array_equal(again, outliers):
                break
            if (
                np.count_nonzero(again != outliers) < EVIDENCE.changed_rows * self.observations.n
            ):  # no reason to decide anew
                work.base = self._fit(self.fitted.machine, again)
                fits = self._fits(work)
                formed = self._formed(fits[-1], outside.forms)
                break
            outliers = again
        return self._told(work, outside, fits, formed)

    def _cannot_tell(self, base: Fit) -> str:
        """Return why nothing can be told, or nothing."""
        poses = len(np.unique(base.observations.pose[~base.outliers]))
        if base.problem.is_closed_chain:
            other = in_another_mode(base.observations, base.problem.model.machine)
            if other > 0.5:
                return (
                    f"In {other:.0%} of the rows another assembly mode than that of [geometry] start is nearer to the "
                    "readings."
                )
            if not base.solution.converged:
                row = weakest(base.observations)
                near = f", as in {base.observations.data.place(row)}" if row is not None else ""
                return (
                    f"The fit stopped where legs do not close: near a singular pose{near}, or far from the right "
                    "geometry."
                )
        if base.degrees_of_freedom < EVIDENCE.fewest_spare_readings:
            return (
                f"{base.degrees_of_freedom} readings more than the parameters that they determine; "
                f"a test needs {EVIDENCE.fewest_spare_readings} at least."
            )
        if poses < EVIDENCE.fewest_poses:
            return f"Only {poses} pose{'s' * (poses != 1)}; a test needs {EVIDENCE.fewest_poses} at least."
        lacking = [d.text for d in base.determinacy.directions if not d.gauge]
        return " ".join(lacking[:3])

    def _undecided(self, reason: str) -> Diagnosis:
        base = self.fitted
        held_out = self._held_out(base)
        rms = Rms(base.rms, base.rms, held_out, held_out, base.noise.value, base.unit)
        outliers = self._rows(base)
        return Diagnosis(
            "cannot_tell",
            reason,
            self.given.n,
            outliers,
            self._with_test(rms, [base]),
            (),
            (),
            (),
            (base,),
        )

    # what everything rests on --------------------------------------------------------------------------------

    def _gross(self, look: _Look) -> Mask:
        self.tell("gross errors")
        carriers = look.carriers
        every = np.concatenate(
            [carriers.model[:, :, :0], *(c.columns for c in _one_each(look.found))], axis=2
        )
        wrong = gross_errors(carriers.model, every, carriers.residual)
        found = np.zeros(self.observations.n, bool)
        found[carriers.rows[wrong]] = True
        return self._alone(found)

    def _alone(self, outliers: Mask) -> Mask:
        """Return no outliers where they lie side by side: these show something, and are not wrong."""
        o = self.observations
        drivers = [o.q[:, j] for j in range(o.q.shape[1])] + ([] if o.t is None else [o.t])
        drivers += [*o.temperature.values(), *o.covariates.values()] + ([] if o.load is None else [o.load])
        if outliers.any() and together(outliers, drivers):
            return np.zeros_like(outliers)
        return outliers

    def _work(self, base: Fit, look: _Look) -> _Work:
        carriers, found = look.carriers, look.found
        model = carriers.model
        self.tell("correlation")
        how = correlation(carriers, [c.columns for c in found])
        self.tell("scores")
        space = Space(model, found, how.whiten)
        residual, total = space.residual(carriers.residual)
        blocks = Blocks(carriers.observations, model, carriers.residual)
        stretches = None
        if not how.independent:
            stretches = Blocks(carriers.observations, model, carriers.residual, stretches=True)
        clusters = Clusters(carriers, how.whiten)
        selection = Selection(space, blocks, self.observations.n, clusters, stretches)
        return _Work(base, carriers, found, how, space, selection, residual, total)

    def _outside(self, work: _Work, final: Fit) -> Outside:
        self.tell("forms outside the catalogue")
        left = work.carriers.residual_of(final)
        return outside_of(work.carriers, work.correlation, work.selection, work.chosen, left)

    # full fits -----------------------------------------------------------------------------------------------

    def _fit(self, machine: Machine, outliers: Mask) -> Fit:
        self.tell("fit")
        return self.fitted.refit(
            machine, self.observations, outliers=outliers, compiled=self.observations.n >= COMPILE_FROM
        )

    def _fits(self, work: _Work) -> list[Fit]:
        """Fit the model with one effect after the other, each from where the one before ended."""
        fits = [work.base]
        for candidate in work.chosen:
            machine = fits[-1].machine.with_effect(candidate.effect)
            searched = {candidate.effect.key(name): value for name, value in candidate.searched.items()}
            fits.append(
                self._fit(replace(machine, values={**machine.values, **searched}), work.base.outliers)
            )
        return fits

    def _unsure(self, work: _Work, final: Fit) -> Candidate | None:
        """Return an effect without which a full fit is as good, although its columns promised otherwise."""
        numbers = Numbers(final, work.carriers, work.correlation)
        for candidate in work.chosen:
            if numbers.significance(candidate.effect) >= VERDICT.rare and self._is_as_good_without(
                final, candidate
            ):
                return candidate
        return None

    def _is_as_good_without(self, final: Fit, candidate: Candidate) -> bool:
        held = dict.fromkeys(candidate.effect.parameters, 0.0) | dict(candidate.searched)
        effects = tuple(
            replace(effect, hold=held) if effect is candidate.effect else effect
            for effect in final.machine.effects
        )
        without = self._fit(replace(final.machine, effects=effects), final.outliers)
        further = final.determinacy.rank - without.determinacy.rank
        fall = without.chi_square - final.chi_square
        if further < 1 or not fall > 0:
            return True
        log = log_p_of_fall(fall, final.chi_square, further, max(final.degrees_of_freedom, 1))
        return bool(log > np.log(VERDICT.rare))

    def _judged(self, final: Fit, outliers: Mask) -> Mask:
        """Return which rows the final model, with the forms that it needs, does not believe."""
        found = gross_rows(final.problem, final.solution, final.free)
        return self._alone(found) if found.mean() < EVIDENCE.largest_wrong_part else outliers

    def _rows(self, base: Fit) -> tuple[int, ...]:
        """Return the outliers as rows of the data that were given."""
        return tuple(self.kept[base.outliers].tolist())

    def _held_out(self, found: Fit) -> float | None:
        return found.held_out(folds=EVIDENCE.folds, progress=self.progress).rms

    # what is told --------------------------------------------------------------------------------------------

    def _told(
        self, work: _Work, outside: Outside, fits: list[Fit], formed: Sequence[tuple[str, Fit]]
    ) -> Diagnosis:
        final = fits[-1]
        last = formed[-1][1] if formed else final
        how = self._how(work, outside, last)
        numbers = Numbers(final, work.carriers, how)
        self.tell("error on poses left out")
        held_out = [self._held_out(found) for found in fits]
        kept = outside.kept
        self.tell("what else would explain it")
        steps = []
        selection = outside.selection
        residual, total = selection.space.residual(work.carriers.residual)
        full = work.correlation.independent and not outside.forms
        for k, candidate in enumerate(kept):
            others = [c for c in kept if c is not candidate]
            log10 = selection.log_p(residual, total, others, candidate) / np.log(10)
            steps.append(
                DiagnosedEffect(
                    candidate.effect,
                    max(10 ** max(log10, -300), SMALLEST_P),
                    log10,
                    fits[k + 1].rms,
                    held_out[k + 1],
                    numbers.of(candidate.effect),
                    aliases_of(selection, work.carriers, final, kept, k, full),
                )
            )
        unexplained = tuple(self._forms(outside.forms, formed))
        rms = Rms(work.base.rms, final.rms, held_out[0], held_out[-1], final.noise.value, final.unit)
        for form in outside.small:
            self.notes.append(
                f"{form.where[0].upper()}{form.where[1:]} follows {form.driver} ({form.formula}), too, but so little "
                "beside the effects found there that it may be what is not exact in their formulas."
            )
        moved = [jump(work.carriers, work.carriers.residual_of(last)), in_order_of_time(work.carriers, how)]
        verdict, reason = self._verdict(final, how, steps, unexplained)
        if reason is not None:
            reason = " ".join(filter(None, [reason, *moved]))
        else:
            self.notes += filter(None, [*moved, how.text])
        if steps and not unexplained and (rest := disagreement(final, how)):
            self.notes.append(f"This is not all: {rest[:1].lower()}{rest[1:]}")
        return Diagnosis(
            verdict,
            reason,
            self.given.n,
            self._rows(work.base),
            self._with_test(rms, fits),
            tuple(steps),
            unexplained,
            _ranking(work),
            tuple(fits),
            how,
            tuple(self.notes),
        )

    def _verdict(
        self, final: Fit, how: Correlation, steps: Sequence[DiagnosedEffect], forms: Sequence[Unexplained]
    ) -> tuple[str, str | None]:
        if forms:
            return "unknown_effect", None
        if steps:
            return "effects_missing", None
        reason = disagreement(final, how)
        return ("cannot_tell", reason) if reason else ("nothing_missing", None)

    def _how(self, work: _Work, outside: Outside, final: Fit) -> Correlation:
        """Return how readings depend on each other beside all that was found."""
        if work.correlation.independent or not (outside.kept or outside.forms):
            return work.correlation
        carriers = replace(work.carriers, residual=work.carriers.residual_of(final))
        found = [*(c.columns for c in outside.kept), *(f.columns for f in outside.forms)]
        return correlation(carriers, found)

    def _formed(self, final: Fit, forms: Sequence[Form]) -> list[tuple[str, Fit]]:
        """Fit the model with one form after the other; return each as it stands in a machine file, with its fit."""
        found: list[tuple[str, Fit]] = []
        for form in forms:
            machine = found[-1][1].machine if found else final.machine
            block = form.block(machine)
            found.append((block, self._fit(machine.with_effect(form.effect(machine)), final.outliers)))
        return found

    def _forms(self, forms: Sequence[Form], formed: Sequence[tuple[str, Fit]]) -> Iterator[Unexplained]:
        for form, (block, found) in zip(forms, formed, strict=True):
            yield Unexplained(
                form.driver,
                form.component,
                form.place,
                form.formula,
                form.p_value,
                found.rms,
                form.parameters,
                block,
                found,
            )

    def _with_test(self, rms: Rms, fits: Sequence[Fit]) -> Rms:
        if self.others is None:
            return rms
        before = error_on(fits[0], self.others)
        try:
            after = error_on(fits[-1], self.others)
        except InputFileError as error:  # without a column that an effect needs, which was found only now
            self.notes.append(f"The error after it on further measurements cannot be told: {error}.")
            after = None
        return replace(rms, before_test=before, after_test=after)


def _one_each(found: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates, those with a searched parameter at a few of its values."""
    by_key: dict[tuple[str, str | None], list[Candidate]] = {}
    for candidate in found:
        by_key.setdefault(candidate.key, []).append(candidate)
    return [c for several in by_key.values() for c in several[:: max(len(several) // 4, 1)]]


def _ranking(work: _Work) -> tuple[Ranked, ...]:
    total = work.selection.left(work.residual, work.total, [])
    scores = work.space.scores(work.residual, total)
    tests = np.log(work.space.tests(scores)) if scores else 0.0
    found = []
    for s in scores:
        log10 = min((s.log_p + tests) / np.log(10), 0.0)
        freedoms = (float(s.freedoms), float(s.spare))
        explains = s.fall / total if total > 0 else 0.0
        p = max(10 ** max(log10, -300), SMALLEST_P)
        found.append(Ranked(s.candidate.effect, p, float(log10), s.statistic, freedoms, s.visible, explains))
    return tuple(found)
