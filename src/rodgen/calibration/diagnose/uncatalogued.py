"""Whether something outside the catalogue acts, which effects of the catalogue would only imitate together.

Two explanations compete: effects of the catalogue first, and forms of the dictionary for what they leave; or forms
first, and effects for what these leave. The cheaper one is chosen: chi-square, plus, for each parameter, effect and
form, what chance gains by having that many to choose from. Where effects alone explain all, they are believed
unless forms do clearly better.

Columns decide that. Where they decide for forms, full fits have the last word (`Contest.rivals`, `Contest.believed`): a
form is believed only if no effect of the catalogue, or two, come as near in a fit of the whole model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.criteria import Found
from rodgen.calibration.diagnose.forms import Form, find_forms
from rodgen.calibration.diagnose.poses import Blocks, stretches_of_time
from rodgen.calibration.diagnose.selection import Selection
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.statistics.columns import ColumnSpace, Whiten
from rodgen.statistics.thresholds import EFFECT_TEST, SELECTION, UNCATALOGUED, VERDICT


@dataclass(frozen=True)
class Explanation:
    """Effects of the catalogue, and forms for what they leave, that together explain the residuals."""

    kept: tuple[Candidate, ...]
    """Effects of the catalogue."""
    forms: tuple[Form, ...]
    """For what these leave unexplained."""
    selection: Selection = field(repr=False)
    """In a space where the forms belong to the model."""
    small: tuple[Form, ...] = ()
    """Forms so small, compared with an effect at the same place, that they may be imperfections of its formula."""
    complete: bool = False
    """Whether effects leave nothing, not even what further ones of the catalogue would explain."""

    @property
    def size(self) -> int:
        """Number of its effects and forms."""
        return len(self.kept) + len(self.forms)

    def tests_of(self, candidate: Candidate) -> float:
        """Return as how many independent tests all candidates count for an effect, given the others; 1 or more.

        Likelier effects before the data have a larger share of the false alarms, as where they were selected.
        """
        others = [c for c in self.kept if c is not candidate]
        return max(self.selection.tests(others) * float(np.exp(-self.selection.log_weight(candidate))), 1.0)


@dataclass(frozen=True)
class Contest:
    """The explanations that compete, and what each costs."""

    sensitivities: Sensitivities
    """Of the model as it was."""
    whiten: Whiten
    """From columns (n, m, k) to columns whose errors are independent and alike."""
    selection: Selection
    """In the space of the model and all candidates."""
    undecided: tuple[Candidate, ...] = ()
    """Effects that were refused because the data have too few positions of a joint: what these do is no form."""

    def by_columns(self, chosen: Sequence[Candidate], left: Array) -> Explanation:
        """Return the explanation of the residuals that costs less by its columns: effects first, or forms first.

        Parameters
        ----------
        chosen : sequence of Candidate
            What the selection chose.
        left : ndarray, shape (n, m)
            Weighted residuals of the full fit with these.
        """
        first = self.effects_first(chosen, left)
        if not first.forms and not chosen:
            return first
        second = self.forms_first()
        if second is None:
            return first
        # forms come first where they are simpler than a heap of effects, or where effects leave something
        if second.size > first.size and (first.complete or first.forms):
            return first
        scale = min(self.variance(first), self.variance(second))
        margin = 0.0
        if (
            first.complete
        ):  # effects explain all: forms must do clearly better, the more so if they are as many
            margin = self._clearly * (2 if second.size == first.size else 1)
        better = self.cost(second, scale) + margin < self.cost(first, scale)
        return second if better else first

    @property
    def _clearly(self) -> float:
        """By how much forms must be cheaper than effects that do the same."""
        return SELECTION.parameter_cost(self.selection.rows)

    # forms against full fits of effects ----------------------------------------------------------------------

    def rivals(self, explanation: Explanation, chosen: Sequence[Candidate]) -> list[tuple[Candidate, ...]]:
        """Return sets of effects that may do what the forms of an explanation do, those first that promise most.

        Its own effects, or those that the selection chose, are joined by none, one or two others. What by its columns
        is so much dearer that no full fit makes up for it is left out, and so is what chance or no machine does.

        Parameters
        ----------
        chosen : sequence of Candidate
            What the selection chose.
        """
        space = self.selection.space
        variance = self.variance(explanation)
        explained = (self._left((), ()) - self._left(explanation.kept, explanation.forms)) / variance
        slack = SELECTION.alternative_limits * self._clearly + SELECTION.alternative_bent * explained
        most = self.cost(explanation, variance) + slack
        found: dict[frozenset[tuple[str, str | None]], tuple[float, tuple[Candidate, ...]]] = {}

        def offer(cost: float, rival: tuple[Candidate, ...]) -> None:
            key = frozenset(c.key for c in rival)
            if cost < most and (key not in found or cost < found[key][0]):
                found[key] = cost, rival

        for kept in (tuple(explanation.kept), tuple(chosen)):
            before = self.cost(Explanation(kept, (), self.selection), variance)
            offer(before, kept)
            scores = [s for s in self.selection.scores(kept) if s.dof]
            if not scores:
                continue
            price = self.selection.price_of_each(variance, kept, [s.candidate for s in scores])
            alone = before + price - np.array([s.fall for s in scores]) / variance
            both = (
                before
                + price
                + price[:, None]
                - space.pair_falls(self.selection.residual, scores, kept) / variance
            )
            both = np.where(np.triu(np.ones_like(both), 1) > 0, both, np.inf)
            for i in np.argsort(alone)[: UNCATALOGUED.rivals]:
                offer(alone[i], (*kept, scores[i].candidate))
            for k in np.argsort(both, axis=None)[: UNCATALOGUED.rivals]:
                i, j = np.unravel_index(k, both.shape)
                offer(both[i, j], (*kept, scores[i].candidate, scores[j].candidate))
        ranked = [rival for _, rival in sorted(found.values(), key=lambda pair: pair[0])]
        return [rival for rival in ranked if rival and self._is_credible(rival)][: UNCATALOGUED.rivals]

    def _is_credible(self, rival: Sequence[Candidate]) -> bool:
        """Return whether a machine may have each effect of a set, and chance hardly does as much, given the others."""
        if self.selection.impossible(rival):
            return False
        return all(
            self.selection.log_p([c for c in rival if c is not own], own) < np.log(VERDICT.rare)
            for own in rival
        )

    def believed(self, fitted: Sequence[tuple[Explanation, Array]]) -> int:
        """Return the number of the explanation that full fits make the likeliest; forms must do clearly better.

        Parameters
        ----------
        fitted : sequence of (Explanation, ndarray of shape (n, m))
            Each with the weighted residuals of its full fit.
        """
        scale = min(self.variance(explanation, left) for explanation, left in fitted)
        costs = [
            self.cost(explanation, scale, left) + (self._clearly if explanation.forms else 0.0)
            for explanation, left in fitted
        ]
        return int(np.argmin(costs))

    # by columns ----------------------------------------------------------------------------------------------

    def effects_first(self, chosen: Sequence[Candidate], left: Array) -> Explanation:
        """Return the explanation by chosen effects, and forms for the residuals of the full fit with these."""
        sensitivities = replace(self.sensitivities, residual=left)
        real = self._real(self._forms_given(chosen, sensitivities), chosen)
        found = self._without_small(chosen, [form for form in real if self._is_outside(form)])
        return replace(found, complete=len(found.small) == len(real))

    def _forms_given(self, chosen: Sequence[Candidate], sensitivities: Sensitivities) -> list[Form]:
        """Return the forms of what chosen effects, and those that may be there all the same, leave of residuals."""
        model = sensitivities.model
        there = {c.key: c for c in (*self.undecided, *chosen)}
        further = np.concatenate([model[:, :, :0], *(c.columns for c in there.values())], axis=2)
        return find_forms(sensitivities, self.whiten, model, further, most=UNCATALOGUED.most_forms)

    def _is_outside(self, form: Form) -> bool:
        """Return whether the catalogue lacks a form, and no effect of it that may be there does the same."""
        if form.in_catalogue:
            return False
        columns = self._seen((), form.columns)
        return not any(
            self._seen((candidate,), form.columns) < SELECTION.in_part * columns
            for candidate in self.undecided
        )

    def _seen(self, kept: Sequence[Candidate], columns: Array) -> float:
        """Return the size of what columns do and the model with some effects does not."""
        parts = [self.sensitivities.model, *(c.columns for c in kept), columns]
        white = self.whiten(np.concatenate(parts, axis=2)).reshape(columns.shape[0] * columns.shape[1], -1)
        own = columns.shape[2]
        return float(np.linalg.norm(ColumnSpace.of(white[:, :-own]).project_out(white[:, -own:])))

    def _real(self, found: Sequence[Form], kept: Sequence[Candidate]) -> list[Form]:
        """Return the forms that exceed the errors that readings of a pose share."""
        forms: list[Form] = []
        for form in found:
            others = [*(c.columns for c in kept), *(f.columns for f in found if f is not form)]
            clusters = self.selection.clusters
            tries = float(EFFECT_TEST.searched_values) ** form.terms
            log = max(
                form.log10_p * np.log(10) + clusters.penalty(others, form.columns),
                clusters.log_p_by_position(others, form.columns, form.driver, form.searched, tries),
            )
            if log < np.log(self.selection.level):
                forms.append(form)
        return forms

    def forms_first(self) -> Explanation | None:
        """Return the explanation that begins with forms; None where none remains outside the catalogue."""
        found = self._forms_given((), self.sensitivities)
        forms = [form for form in self._real(found, ()) if self._is_outside(form)]
        if not forms:
            return None
        selection = self._selection_given(forms)
        kept = selection.run()
        found_with = self._without_small(kept, forms, selection)
        return found_with if found_with.forms else None  # effects alone were selected without them already

    def _selection_given(self, forms: Sequence[Form]) -> Selection:
        """Return the selection of effects in a model that has the forms."""
        model = np.concatenate([self.sensitivities.model, *(form.columns for form in forms)], axis=2)
        o, residual = self.sensitivities.observations, self.sensitivities.residual
        stretches = None
        if self.selection.stretches is not None:
            stretches = Blocks(o, model, residual, stretches_of_time(o))
        space = CandidateSpace(model, self.selection.space.candidates, self.whiten)
        return replace(
            self.selection,
            space=space,
            blocks=Blocks(o, model, residual),
            stretches=stretches,
            _found=Found(),
        )

    def _without_small(
        self, kept: Sequence[Candidate], forms: Sequence[Form], selection: Selection | None = None
    ) -> Explanation:
        small = [form for form in forms if self._is_imperfection(kept, form)]
        large = [form for form in forms if form not in small]
        if selection is None or small:
            selection = self._selection_given(large) if large else self.selection
        if large:
            kept = selection.pruned(kept)
        return Explanation(tuple(kept), tuple(large), selection, tuple(small))

    def _is_imperfection(self, kept: Sequence[Candidate], form: Form) -> bool:
        here = [c for c in kept if c.effect.place in {form.place, form.driver}]
        if not here:
            return False
        others = [c for c in kept if c not in here]
        explained = self._left(others, ()) - self._left(kept, ())
        gained = self._left(kept, ()) - self._left(kept, (form,))
        return gained < SELECTION.imperfect**2 * explained

    # what it costs -------------------------------------------------------------------------------------------

    def _left_and_rank(
        self, kept: Sequence[Candidate], forms: Sequence[Form], residual: Array | None = None
    ) -> tuple[float, int, int]:
        """Return the residual sum of squares, the number of parameters, and that of readings."""
        residual = self.sensitivities.residual if residual is None else residual
        columns = [self.sensitivities.model, *(c.columns for c in kept), *(f.columns for f in forms)]
        every = np.concatenate([*columns, residual[:, :, None]], axis=2)
        white = self.whiten(every).reshape(-1, every.shape[2])
        space = ColumnSpace.of(white[:, :-1])
        return float(np.sum(space.project_out(white[:, -1]) ** 2)), space.rank, len(white)

    def _left(self, kept: Sequence[Candidate], forms: Sequence[Form]) -> float:
        return self._left_and_rank(kept, forms)[0]

    def variance(self, explanation: Explanation, residual: Array | None = None) -> float:
        """Return the residual variance of a whitened reading; see `cost`."""
        left, rank, readings = self._left_and_rank(explanation.kept, explanation.forms, residual)
        return left / max(readings - rank, 1)

    def cost(self, explanation: Explanation, variance: float, residual: Array | None = None) -> float:
        """Return chi-square of an explanation, plus what its parameters, their sizes and the choice of its terms cost.

        Parameters of forms, which have no usual sizes, cost ln(rows) each (Schwarz).

        Parameters
        ----------
        variance : float
            Of a whitened reading.
        residual : ndarray, shape (n, m), optional
            Weighted residuals of its full fit, left out: those of the model as it was. What its columns make up for is
            taken off either: readings that depend on each other were fitted as if they did not.
        """
        left, rank, _ = self._left_and_rank(explanation.kept, explanation.forms, residual)
        variance = max(variance, 1e-300)
        of_forms = (
            rank - self._left_and_rank(explanation.kept, ())[1] + sum(f.searched for f in explanation.forms)
        )
        forms = np.log(self.selection.rows) * of_forms + UNCATALOGUED.a_form * len(explanation.forms)
        return float(left / variance + forms + explanation.selection.cost_before(variance, explanation.kept))
