"""The error of a machine's model, falling from effect to effect, compared with the noise.

Each rung is a fit that starts from the values of the one before, so that a model with more in it never fits worse. The
error on the poses that a fit saw always falls; that on poses that it did not see shows whether the effect is real.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.error_table import THE_FILE, Model, error_table
from rodgen.calibration.fit import Estimate, Fit, fit
from rodgen.calibration.held_out import HeldOut, held_out
from rodgen.calibration.noise_floor import NoiseFloor
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.solve.least_squares import minimise
from rodgen.calibration.steps import StepOdds, odds_of_steps
from rodgen.calibration.words import UNWEIGHED, odds_text
from rodgen.document import Document, Documented, Paragraph, Table
from rodgen.errors import RodgenError, counted
from rodgen.machines.machine import Effect, Machine
from rodgen.statistics.thresholds import LACK_OF_FIT
from rodgen.views import Result, plain


@dataclass(frozen=True, repr=False)
class Rung(Documented, Result):
    """A model on the ladder.

    Attributes
    ----------
    title : str
        ``"base"``, ``"+ refraction"``, ``"- backlash at C"``.
    effect : Effect or None
        What was added or taken away.
    fit : Fit
    held_out : HeldOut
    step : StepOdds or None
        What the effect is worth, given all others; None of the first rung, and where it cannot be judged.
    """

    title: str
    effect: Effect | None
    fit: Fit
    held_out: HeldOut
    step: StepOdds | None = None

    @property
    def verdict(self) -> str:
        """One sentence on what the effect is worth; empty of the first rung."""
        if self.effect is None:
            return ""
        name = self.effect.title
        if self.step is None:
            why = "the data determine none of its parameters, or hold no more readings than the model has parameters"
            return f"{name} cannot be judged: {why}."
        if not self.step.needed:
            return f"{name} does not show in these data: {self.step.text}."
        text = f"{name} shows in these data: {self.step.text}. Another effect may explain the same."
        left = self.fit.lack_of_fit
        if left is not None and left.p_value < LACK_OF_FIT.improbable:
            text += f" The residuals are still {left.ratio:.2g} times the noise: this is not it, or not all."
        return text

    @property
    def parameters(self) -> dict[str, Estimate]:
        """The parameters of the effect, by their keys; none where it is not in the model."""
        if self.effect is None:
            return {}
        return {key: e for key, e in self.fit.estimates.items() if self.effect.owns(key)}

    def document(self) -> Document:
        """Return what the effect is worth, its parameters with those that change with it, and its meaning."""
        effect, fit = self.effect, self.fit
        if effect is None:
            return Document([])
        needed = self.step is not None and self.step.needed
        if effect not in fit.machine.effects:
            keep = "Without it the model is worse than it can be: keep it."
            return Document([Paragraph(text, "line") for text in (self.verdict, keep)[: 1 + needed]])
        adjusted = self.parameters
        waiting = {p.key for p in fit.parameters if p.optional}  # estimated only when the data call for it
        keys = [*adjusted, *(p.key for p in fit.parameters if p.effect is not None and p.key not in adjusted)]
        rows = [
            (e.key, e.text)
            for e in (fit.estimates[key] for key in keys)
            if not e.held or e.value or (e.key in adjusted and e.key not in waiting)
        ]
        about = effect.definition.paragraphs("Meaning", "Usual size", *(["Remedy"] if needed else []))
        table = [Table((), rows)] if rows else []
        return Document(
            [Paragraph(self.verdict, "line"), *table, *(Paragraph(each, "line") for each in about)]
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            **plain(self, "title effect=effect.name place=effect.place"),
            "effects": [effect.title for effect in self.fit.machine.effects],
            **plain(self, "rms=fit.rms rms_held_out=held_out.rms held_out unit=fit.unit"),
            "parameters_estimated": len(self.fit.free),
            **plain(self, "outliers=fit.outlier_numbers converged=fit.solution.converged"),
            **plain(self, "dependence=fit.dependence step parameters=fit.estimates"),
        }


@dataclass(frozen=True, repr=False)
class Ladder(Documented, Result):
    """Models of one machine, each with an effect more or less than the one before.

    Attributes
    ----------
    rungs : tuple of Rung
    """

    rungs: tuple[Rung, ...]

    @property
    def noise(self) -> NoiseFloor:
        """The noise, from the model with the most parameters."""
        floor: NoiseFloor = max((rung.fit for rung in self.rungs), key=lambda f: len(f.free)).noise
        return floor

    @property
    def models(self) -> list[Model]:
        """The rungs as a table and a figure show them."""
        return [
            Model(
                rung.title if k else THE_FILE,
                rung.fit.rms,
                rung.held_out.rms,
                odds_text(rung.step.odds) if rung.step else "",
                parameters=len(rung.fit.free),
            )
            for k, rung in enumerate(self.rungs)
        ]

    def document(self) -> Document:
        """Return a table of the errors, and what there is to say of them."""
        first = self.rungs[0].fit
        table = error_table(self.models, first.unit, self.noise)
        sentences = [Paragraph(text, "line") for text in self._sentences()]
        return Document([table, *sentences], f"{first.machine.name}, {first.observations.data.file}")

    def _sentences(self) -> Iterator[str]:
        yield self.noise.text
        yield from dict.fromkeys(rung.held_out.note for rung in self.rungs if rung.held_out.note)
        weighed = any(rung.fit.weighed for rung in self.rungs)
        if weighed:
            yield UNWEIGHED
        for before, after in pairwise(self.rungs):
            grows = len(after.fit.machine.effects) > len(before.fit.machine.effects)
            if grows and not weighed and after.held_out.rises_from(before.held_out):
                yield f"{after.title}: poses held out are predicted no better with it."
        for model, rung in zip(self.models, self.rungs, strict=True):
            if count := int(rung.fit.outliers.sum()):
                # outliers of a fit, or rows that a session sets aside
                yield f"{model.title}: {counted(count, 'row')} left out."
            if not rung.fit.solution.converged:
                yield f"{model.title}: NOT CONVERGED, the figures are where the fit stopped."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        first, used = self.rungs[0].fit, self.rungs[-1].fit.used_rows
        named = plain(first, "machine=machine.name data=observations.data.file")
        return named | used | plain(first, "unit") | plain(self, "noise rungs")


def ladder(machine: Machine, data: Any, steps: Sequence[Effect]) -> Ladder:
    """Add effects one after the other, and watch the error fall.

    Parameters
    ----------
    machine : Machine
        The first rung.
    data : Measurements, Observations or a table in memory
    steps : sequence of Effect
        See :meth:`rodgen.machines.machine.Machine.effect`.

    Returns
    -------
    Ladder

    Raises
    ------
    InputFileError
        When an effect cannot stand at its place, or the data do not fit the machine.
    FitError
        When there is nothing to fit.

    Examples
    --------
    >>> from rodgen.calibration.simulate import simulate
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"), estimate=("target",),
    ... )
    >>> design = Measurements.from_frame({"C [deg]": np.arange(0.0, 360.0, 10.0)})
    >>> data = simulate(table, design, ["encoder_ellipticity@C:a=20arcsec"], noise="2um", seed=1).data
    >>> found = ladder(table, data, [table.effect("encoder_ellipticity", "C")])
    >>> [(rung.title, round(rung.fit.rms, 3)) for rung in found.rungs]
    [('base', 0.004), ('+ encoder_ellipticity at C', 0.002)]
    >>> found.rungs[1].held_out.rms < found.rungs[0].held_out.rms, found.rungs[1].step.needed
    (True, True)
    """
    machines = [machine]
    for effect in steps:
        machines.append(machines[-1].with_effect(effect))
    return ladder_of(machines, data)


def ladder_of(
    machines: Sequence[Machine],
    data: Any,
    *,
    loss: str = "linear",
) -> Ladder:
    """Fit machines, each of which has one effect more, or one less, than the one before.

    Parameters
    ----------
    data
        As for `ladder`.
    loss : {"linear", "huber"}
        As in `fit`.
    """
    # What is bound is the same for all of them: it depends on joints, targets and what is measured.
    observations = bind_once(machines[0], data)
    fits: list[Fit] = []
    for machine in machines:
        if fits:
            machine = _started(machine, fits[-1])
        fits.append(fit(machine, observations, loss=loss))
    for k in range(len(fits) - 1, 0, -1):
        fits[k] = _not_worse(fits[k], fits[k - 1])
    for k in range(1, len(fits)):
        fits[k - 1] = _not_worse(fits[k - 1], fits[k])
    changes = [_changed(before.machine, after.machine) for before, after in pairwise(fits)]
    odds = _odds(fits[0], fits[-1], [effect for effect, _ in changes])
    steps = zip(fits[1:], changes, odds, strict=True)
    rungs = [Rung(f"{sign} {e.title}", e, after, held_out(after), one) for after, (e, sign), one in steps]
    return Ladder((first_rung(fits[0]), *rungs))


def _odds(before: Fit, after: Fit, effects: Sequence[Effect]) -> list[StepOdds | None]:
    """Return what each effect that came, or went, is worth given all others: what comes later is no noise."""
    smaller, larger = sorted((before, after), key=lambda f: len(f.machine.effects))
    return odds_of_steps(smaller, larger, effects)


def first_rung(fit: Fit) -> Rung:
    """Return a fit as the first rung of a ladder."""
    return Rung("base", None, fit, held_out(fit))


def fit_after(before: Fit, machine: Machine, outliers: NDArray[np.bool_]) -> Fit:
    """Return the fit after a change, to the same observations; it starts from the values of the fit before.

    Parameters
    ----------
    machine : Machine
        After the change, without fitted values.
    outliers : ndarray of bool, shape (n,)
        Rows that are not to be believed.
    """
    return _not_worse(fit(_started(machine, before), before.observations, outliers=outliers), before)


def next_rung(before: Fit, after: Fit, title: str) -> Rung:
    """Return a fit as the rung after another, with one change: of effects, of what is held or known, or of rows.

    An effect is weighed where it is all that changed, and the rows are the same.
    """
    effect = None
    with suppress(RodgenError):
        effect, _ = _changed(before.machine, after.machine)
    same = before.observations is after.observations and np.array_equal(before.outliers, after.outliers)
    odds = _odds(before, after, [effect])[0] if same and effect is not None else None
    return Rung(title, effect, after, held_out(after), odds)


def _started(machine: Machine, before: Fit) -> Machine:
    """Return a machine with the values of the fit before, as far as it has the parameters."""
    gone = [e for e in before.machine.effects if e.identity not in {f.identity for f in machine.effects}]
    start = before.machine
    for effect in gone:
        start = start.without_effect(effect.name, effect.place)
    return replace(machine, values={**machine.values, **start.values})


def _changed(before: Machine, after: Machine) -> tuple[Effect, str]:
    """Return the effect that one of two machines has more, and whether it came or went."""
    there, here = ({e.identity: e for e in m.effects} for m in (before, after))
    came = [here[key] for key in here if key not in there]
    went = [there[key] for key in there if key not in here]
    if len(came) + len(went) != 1:
        raise RodgenError(
            "machines that differ by more than one effect; expected one effect from rung to rung"
        )
    return (came[0], "+") if came else (went[0], "-")


def _not_worse(larger: Fit, smaller: Fit) -> Fit:
    """Return the larger fit, from where the smaller one ended if it had ended in a worse valley than that."""
    comparable = np.array_equal(larger.outliers, smaller.outliers)
    comparable &= len(larger.machine.effects) > len(smaller.machine.effects)
    if not comparable or larger.chi_square <= smaller.chi_square:
        return larger
    model = larger.problem.model
    theta = model.start()
    theta_of = dict(zip((p.key for p in smaller.parameters), smaller.solution.theta, strict=True))
    for i, parameter in enumerate(model.parameters):
        if parameter.hold is None:
            theta[i] = theta_of.get(parameter.key, 1.0 if parameter.searched else 0.0)
    with one_thread_in_blas():
        solution = minimise(larger.problem, theta, smaller.solution.frame, larger.free)
    if solution.cost >= larger.chi_square:
        return larger
    values = {p.key: float(solution.theta[i]) for i, p in enumerate(model.parameters)}
    return replace(larger, machine=replace(larger.machine, values=values), solution=solution)
