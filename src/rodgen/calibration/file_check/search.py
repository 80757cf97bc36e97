"""Whether a machine file and its data are plausible at all, and what is wrong where they are not.

A fit that was made anyway raises a suspicion (`suspicion`). Only then is anything tried: each thing that people get
wrong (`repairs`) by a fit that stays near the file (`near_file`), and, where none suffices, the most promising with a
second one. A file is called wrong where a repair makes the data much more likely, or where even the best numbers near
the file are absurd.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.file_check.near_file import ROUNDS, NearFit, exchanged, fit_near, motion
from rodgen.calibration.file_check.repairs import Repair, Rows, offsets, repairs
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import other_mode
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.solve.staged_fit import FitError
from rodgen.data.observations import Observations
from rodgen.data.units import unit_factor
from rodgen.errors import InputFileError
from rodgen.machines.machine import Machine
from rodgen.machines.parameters import parameters_of
from rodgen.machines.plausible import relative_corrections
from rodgen.stages import each
from rodgen.statistics.thresholds import CHECK
from rodgen.views import Result, brief, html_of, plain

FIRST_ROUNDS = 2
"""Rounds of a fit after which most repairs are seen to lead nowhere."""


@dataclass(frozen=True)
class Mend:
    """One repair, or two together, with the fit near the file that it makes.

    Attributes
    ----------
    repairs : tuple of Repair
    fit : NearFit
    """

    repairs: tuple[Repair, ...]
    fit: NearFit

    __repr__ = brief
    _repr_html_ = html_of

    @property
    def words(self) -> str:
        """What is wrong, and how to write it."""
        return "; and ".join(repair.words for repair in self.repairs)

    @property
    def effort(self) -> int:
        """How much is changed."""
        return sum(repair.effort for repair in self.repairs)

    @property
    def of_data(self) -> bool:
        """Whether the data are changed."""
        return any(repair.of_data for repair in self.repairs)

    @property
    def of_machine(self) -> bool:
        """Whether the machine file is changed."""
        return not all(repair.of_data for repair in self.repairs)

    def applied(self, machine: Machine, observations: Observations) -> tuple[Machine, Observations]:
        """Return the machine and the observations, mended; without the rows that are `unpaired`."""
        rows = {0: observations}
        if self.offset:
            _, readings = self.unpaired(observations)
            paired = np.setdiff1d(np.arange(observations.n), readings)
            rows = {0: observations.take(paired)}
            rows[self.offset] = observations.take(paired + self.offset).read_as(rows[0])
        made, mended = _mended(self.repairs, machine, rows)
        return made, mended[0]

    @property
    def offset(self) -> int:
        """How many rows later the commands are that belong to readings."""
        return sum(repair.offset for repair in self.repairs)

    def unpaired(self, observations: Observations) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Return the rows whose commands have no readings any more, and those whose readings have no commands."""
        n, rows = observations.n, np.arange(observations.n)
        commands, readings = (rows + shift for shift in (-self.offset, self.offset))
        return rows[(commands < 0) | (commands >= n)], rows[(readings < 0) | (readings >= n)]

    def to_dict(self, observations: Observations) -> dict[str, Any]:
        """Return it as plain data, with the numbers of the rows that it drops."""
        commands, readings = (observations.given(rows).tolist() for rows in self.unpaired(observations))
        return {
            **plain(self, "change=words of_machine of_data"),
            "rows": observations.n - len(readings),
            "commands_without_readings": commands,
            "readings_without_commands": readings,
        }

    def on_rows(self, observations: Observations) -> str:
        """Return a sentence on how many rows the mended data have, and which are dropped."""
        commands, readings = self.unpaired(observations)
        left = f"{observations.n - len(readings)} of {observations.n} rows"
        if not len(readings):
            return f"{left}."
        places = observations.data.places
        return f"{left}: the commands of {places(commands)} and the readings of {places(readings)} have no partner."


@dataclass(frozen=True, repr=False)
class Check(Result):
    """Whether a machine file and its data are plausible.

    Attributes
    ----------
    machine : Machine
    observations : Observations
    suspicions : tuple of str
        What made the files suspicious, in a fit that was made already and in one near the file; without the latter
        nothing was tried.
    wrong : bool
        Whether the files are wrong.
    before : float
        Error near the file as it is, rms of the rows that are not far out, in `unit`.
    after : float or None
        The same with the first repair; None where none was found.
    unit : str
    repairs : tuple of Mend
        What mends them: the smallest change first, then others that do the same to these data.
    """

    machine: Machine
    observations: Observations
    suspicions: tuple[str, ...]
    wrong: bool
    before: float | None
    after: float | None
    unit: str
    repairs: tuple[Mend, ...] = ()

    @property
    def sentence(self) -> str:
        """What is wrong, in one sentence; empty where nothing is."""
        if not self.wrong:
            return ""
        if self.repairs:
            error = f"{self.after:.3g} instead of {self.before:.3g} {self.unit}"
            said = f"{self.repairs[0].words}; with that the error is {error}"
            if self.before and self.after and self.after > self.before / CHECK.better:
                said += f"; without that change {'; '.join(self.suspicions)}"
        elif self.before is None:
            said = "; ".join(self.suspicions)
        else:
            said = f"{'; '.join(self.suspicions)}, and no change that was tried mends that"
        return f"This looks like a wrong file: {said}."

    @property
    def is_shown(self) -> bool:
        """Whether the data could show anything: there are more readings than parameters."""
        o, machine = self.observations, self.machine
        free = sum(p.hold is None for p in parameters_of(machine, machine.structure, o.run_names))
        return bool(o.n * len(machine.measurand.components) > free)

    def summary(self) -> str:
        """Return it as text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield from self.observations.on_rows
        name = f"{self.machine.name}, {self.observations.data.file}"
        if not self.wrong:
            if self.is_shown:
                yield f"{name}: nothing looks wrong."
            else:
                yield f"{name}: too few readings, for as many parameters, to show whether something is wrong."
            return
        yield f"{name}:"
        yield self.sentence
        for mend in self.repairs[1:]:
            yield f"  The same to these data: {mend.words}."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as ``rodgen check --json`` prints it."""
        return {
            **plain(self, "machine=machine.name data=observations.data.file"),
            **self.observations.not_here,
            **plain(self, "wrong suspicions error=before error_mended=after unit"),
            "repairs": [mend.to_dict(self.observations) for mend in self.repairs],
        }

    def __str__(self) -> str:
        return self.summary()


def check(machine: Machine | FittedModel, data: Any = None) -> Check:
    """Return whether a machine file and its data are plausible, and what is wrong where they are not.

    Parameters
    ----------
    machine : Machine or Fit
        A fit that was made already is looked at first: where it shows nothing suspicious no other is made.
    data : Measurements, Observations or a table in memory, optional
        Needed with a machine.

    Returns
    -------
    Check

    Raises
    ------
    InputFileError
        When the data do not fit the machine at all: a column is missing, say.
    FitError
        When a machine comes without data.
    """
    if isinstance(machine, FittedModel):
        fit = machine
        reasons = tuple(suspicions(fit))
        if not reasons:
            return Check(fit.problem.model.machine, fit.observations, reasons, False, None, None, fit.unit)
        searching = _Searching(fit.problem.model.machine, fit.observations, reasons)
    else:
        if data is None:
            raise FitError("a machine without measurements; expected both, or a fit")
        searching = _Searching(machine, bind_once(machine, data), ())
    with one_thread_in_blas(), np.errstate(all="ignore"):
        return searching.run()


class _Searching:
    """The search for what is wrong with files."""

    def __init__(self, machine: Machine, observations: Observations, reasons: tuple[str, ...]) -> None:
        self.reasons = reasons
        self.machine = replace(machine, values={})
        self.observations = replace(observations, machine=self.machine)
        parameters = len(parameters_of(self.machine, self.machine.structure, observations.run_names))
        most = max(CHECK.fewest_rows, CHECK.rows_a_parameter * parameters)
        self.rows = _with_neighbours(self.observations, _some(observations.n, most))
        measurand = machine.measurand
        self.unit = measurand.unit(machine.length_unit)
        self.factor = unit_factor(self.unit, machine.length_unit)[0]

    def run(self) -> Check:
        mode = other_mode(self.observations, self.machine)
        if mode:  # what is tried starts from the poses of the wrong mode, too
            return Check(self.machine, self.observations, (mode,), True, None, None, self.unit)
        before = self._fit((), ROUNDS, compiled=False)
        checked = Check(
            self.machine,
            self.observations,
            self.reasons,
            False,
            None if before is None else before.rms / self.factor,
            None,
            self.unit,
        )
        doubts = tuple(self._doubts(before))
        if not doubts:  # a fit that ended elsewhere was pulled by wrong readings
            return checked
        checked = replace(checked, suspicions=self.reasons + doubts)
        hypotheses = repairs(self.machine, self.observations)
        found = self._tried([(repair,) for repair in hypotheses])
        if found and any(self._doubts(found[0].fit)):
            pairs = self._tried(
                [
                    (*first.repairs, second)
                    for first in found[: CHECK.beam]
                    for second in hypotheses
                    if second.kind != first.repairs[0].kind
                ]
            )
            if pairs and pairs[0].fit.misfit < found[0].fit.misfit - CHECK.decisive:
                found = pairs
        same: list[Mend] = []
        if found and self._is_better(found[0].fit, before):
            same = [mend for mend in found if _does_the_same(mend.fit, found[0].fit)]
            same.sort(key=lambda mend: (mend.effort, mend.fit.misfit))
        wrong = bool(same) or before is None or _is_impossible(before)
        after = same[0].fit.rms / self.factor if same else None
        return replace(checked, wrong=wrong, repairs=tuple(same), after=after)

    def _doubts(self, before: NearFit | None) -> Iterator[str]:
        if before is None:
            yield "the model is not finite with the numbers of the file"
            return
        if before.motion > 0 and before.scale >= CHECK.suspicious_error * before.motion:
            yield (
                f"with numbers near those of the file the error is {before.rms / self.factor:.3g} {self.unit}, "
                f"{100 * before.rms / before.motion:.0f} % of the motion"
            )
        if before.farthest >= CHECK.suspicious_correction:
            yield before.words
        if swapped := exchanged(before.problem.model, before.theta):
            yield swapped

    @staticmethod
    def _is_better(fit: NearFit, before: NearFit | None) -> bool:
        """Return whether a repair makes the data so much more likely that the file is wrong.

        What it saves must be errors of most rows, or corrections that are large: a little of both may be chance.
        """
        if fit.scale >= CHECK.impossible_error * fit.motion or fit.farthest >= 1:
            return False
        if before is None:
            return True
        if before.misfit - fit.misfit < CHECK.decisive:
            return False
        saved = before.corrections - fit.corrections
        much = fit.scale < before.scale / CHECK.better or saved > CHECK.decisive
        return bool(much or _is_impossible(before))

    def _tried(self, chosen: Iterable[tuple[Repair, ...]]) -> list[Mend]:
        """Return the fits with repairs, best first: those that look best after a few steps, then carried on."""
        found = [
            mend
            for some in each("looking for what is wrong", list(chosen))
            if (mend := self._mend(some, FIRST_ROUNDS))
        ]
        found.sort(key=lambda mend: mend.fit.misfit)
        ended = [mend for some in found[: CHECK.finalists] if (mend := self._mend(some.repairs, ROUNDS))]
        return sorted(ended, key=lambda mend: mend.fit.misfit)

    def _mend(self, chosen: tuple[Repair, ...], rounds: int) -> Mend | None:
        fit = self._fit(chosen, rounds)
        return None if fit is None else Mend(chosen, fit)

    def _fit(self, chosen: Sequence[Repair], rounds: int, *, compiled: bool = True) -> NearFit | None:
        try:
            machine, rows = _mended(chosen, self.machine, self.rows)
        except InputFileError:  # legs that do not close
            return None
        if 0 not in rows:
            return None
        compiled &= machine.structure == self.machine.structure  # others are fitted a few times only
        enlarged = float(np.prod([repair.enlarges for repair in chosen]))
        return fit_near(machine, rows[0], rounds=rounds, compiled=compiled, enlarged=enlarged)


def _does_the_same(fit: NearFit, best: NearFit) -> bool:
    """Return whether a repair is as good as the best one: by its likelihood, or by its errors alone."""
    behind = fit.misfit - best.misfit
    errors = behind - (fit.corrections - best.corrections)
    return behind < CHECK.same or (abs(errors) < CHECK.same and behind < CHECK.decisive and fit.farthest < 1)


def _is_impossible(fit: NearFit) -> bool:
    """Return whether files are wrong even if no repair is found: a rough point alone is not."""
    return bool(
        fit.scale >= CHECK.impossible_error * fit.motion or fit.farthest >= CHECK.impossible_correction
    )


def _mended(chosen: Sequence[Repair], machine: Machine, rows: Rows) -> tuple[Machine, Rows]:
    state = machine, rows
    for repair in chosen:
        state = repair(state)
    return state


def _some(n: int, most: int) -> np.ndarray[Any, np.dtype[np.int_]]:
    if n <= most:
        return np.arange(n)
    return np.sort(np.random.default_rng(0).choice(n, most, replace=False))


def _with_neighbours(o: Observations, chosen: np.ndarray[Any, np.dtype[np.int_]]) -> Rows:
    """Return rows, by offset with the commands of their neighbours; of few rows only those as they are."""
    several = offsets(o)
    far = max(several)
    if o.n <= 4 * far:
        return {0: o.take(chosen)}
    inner = chosen[(chosen >= far) & (chosen < o.n - far)]
    found = {0: o.take(inner)}
    for k in several:
        found[k] = o.take(inner + k).read_as(found[0])
    return found


def suspicions(fit: FittedModel) -> Iterator[str]:
    """Yield what a right file hardly ever shows: no convergence, large corrections, errors that no physics makes."""
    if mode := other_mode(fit.observations, fit.problem.model.machine):
        yield mode
    if not fit.solution.converged:
        yield "the fit does not converge"
    moved = motion(fit.problem, fit.solution.theta)
    sizes = np.abs(relative_corrections(fit.problem.model, fit.values, moved))
    if sizes.max(initial=0.0) > CHECK.suspicious_correction:
        worst = fit.parameters[int(np.argmax(sizes))]
        value = fit.values[int(np.argmax(sizes))] / worst.factor
        yield f"the fit changes {worst.key} by {value:.4g} {worst.unit}"
    if swapped := exchanged(fit.problem.model, fit.solution.theta):
        yield swapped
    error = fit.rms * fit.unit_factor
    if moved > 0 and error > CHECK.suspicious_error * moved:
        yield f"the error is {100 * error / moved:.1f} % of the motion"
