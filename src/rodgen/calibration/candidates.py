"""Every effect of the catalogue, at every place, as the columns that it adds to a fit's derivative."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.dependence import FitRows
from rodgen.calibration.sensitivities import MOMENTS, Place, Sensitivities, is_direct
from rodgen.calibration.solve.starting_values import most_waves, wave_falls
from rodgen.data.poses import positions
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.effects.formula import ARRAY_FUNCTIONS
from rodgen.machines.machine import Effect
from rodgen.machines.plausibility import Plausibility, Size, plausibility, reach
from rodgen.machines.rigid import complete_basis
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.thresholds import COST, EVIDENCE, SELECTION

TAUS = 12
"""Number of time constants tried, from the time between two poses to three times the whole duration."""
WAVES_STEP = 0.5
"""Step, in waves over the range of the joint, of the periods that are tried."""
MOST_WAVES = 200.0
"""Most waves over the range that are tried: a lead of 5 mm over a metre, two waves a turn of 100 teeth. A shorter
period must be given in the machine file."""
FEWEST_WAVES = 2.0
"""Fewer waves imitate any smooth curve; an eccentricity and an ellipticity have effects of their own."""
ASSUMED_ORDER = 0.1
"""Odds that a mount was driven to its directions in the order of the rows, with no other motion between."""
WAVE_ROWS, PEAKS, FINER = 1_000, 5, 17
"""Rows on which periods are compared, how many of the best are kept, and among how many near each the best is taken."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect and its columns."""

    effect: Effect
    names: tuple[str, ...]
    """Keys of the parameters."""
    columns: Array
    """Derivative of the weighted residuals by each, (n, m, k)."""
    searched: Mapping[str, float]
    """Values of the parameters that are searched, at which the columns are taken; internal units."""
    tries: float = 1.0
    """Number of independent tests that the values tried for the effect amount to."""
    prior: Plausibility = field(default_factory=Plausibility)
    """What is known of the effect before these data."""
    driver: str = ""
    """What a form outside the catalogue follows."""

    @cached_property
    def short_names(self) -> list[str]:
        """Names of the parameters without the effect's, in the order of the columns."""
        return [name.rpartition(".")[2] for name in self.names]

    @cached_property
    def key(self) -> tuple[str, str | None]:
        """Name and place of the effect."""
        return self.effect.name, self.effect.place


def candidates(
    sensitivities: Sensitivities, effects: list[Effect], prefer: Collection[tuple[str, str | None]] = ()
) -> list[Candidate]:
    """Return the columns of effects that the machine may have; one of each promising value of a searched parameter.

    Of an effect with weights at later joints, one of each choice of these; see `_direct`.

    Parameters
    ----------
    sensitivities : Sensitivities
        Made with these effects.
    prefer : collection of (name, place)
        Effects that a user holds for the likeliest; see :func:`rodgen.machines.plausibility.plausibility`.
    """
    priors = possible(sensitivities, effects, prefer)
    effects = [effect for effect in effects if effect.identity in priors]
    every = [c for effect in effects if is_direct(effect) for c in _direct(sensitivities, effect)]
    waves = []
    for effect in (effect for effect in effects if not is_direct(effect)):
        values, tries = list(_tried(sensitivities, effect)), number_tried(sensitivities, effect)
        if _is_wave(effect) and len(values) > 1:
            waves.append(effect)
        else:
            every += [replace(with_searched(sensitivities, effect, x), tries=tries) for x in values]
    every = [replace(candidate, prior=priors[candidate.key]) for candidate in every]
    if waves:
        for effect, searched in promising_periods(sensitivities, waves, every):
            c = with_searched(sensitivities, effect, searched)
            tries = number_tried(sensitivities, effect)
            every.append(replace(c, tries=tries, prior=_of_wave(priors[c.key], *searched.values())))
    order = {effect.identity: i for i, effect in enumerate(effects)}
    return sorted(every, key=lambda c: order[c.key])


def _of_wave(prior: Plausibility, period: float) -> Plausibility:
    """Return what is known of a wave: at most as steep as would turn the joint back, which no drive does."""
    steepest = period / (2 * np.pi)
    sizes = {
        name: (min(size.usual, steepest), min(size.largest, steepest)) for name, size in prior.sizes.items()
    }
    return replace(prior, sizes={name: Size(*size) for name, size in sizes.items()})


def possible(
    sensitivities: Sensitivities, effects: Sequence[Effect], prefer: Collection[tuple[str, str | None]] = ()
) -> dict[tuple[str, str | None], Plausibility]:
    """Return what is known before the data of those effects that the machine may have, by name and place."""
    machine = sensitivities.fit.machine
    priors = {effect.identity: plausibility(machine, effect, prefer) for effect in effects}
    for effect in effects:
        if _assumes_order(sensitivities, effect):
            prior = priors[effect.identity]
            priors[effect.identity] = replace(prior, log_odds=prior.log_odds + math.log(ASSUMED_ORDER))
    return {
        effect.identity: priors[effect.identity]
        for effect in effects
        if priors[effect.identity].log_odds > -np.inf and not _weightless(sensitivities, effect)
    }


def unsearched(sensitivities: Sensitivities, effect: Effect) -> Candidate | None:
    """Return an effect with its own columns, without weights at later joints; None where a value is to be searched."""
    if is_direct(effect):
        return next(_direct(sensitivities, effect))
    if effect.definition.searched and effect.definition.follows_time:
        return None
    values = list(_tried(sensitivities, effect))
    return with_searched(sensitivities, effect, values[0]) if len(values) == 1 else None


def _assumes_order(sensitivities: Sensitivities, effect: Effect) -> bool:
    """Return whether an effect needs a direction of approach that is only assumed from the order of the rows."""
    o = sensitivities.observations
    if "s" not in effect.definition.formula.names or effect.definition.own:
        return False
    return bool(o.approach_assumed[_number(sensitivities, effect)])


def _weightless(sensitivities: Sensitivities, effect: Effect) -> bool:
    """Return whether an effect needs a moment of gravity and there is hardly any, as about an upright axis."""
    definition = effect.definition
    if definition.component not in {"reading", "rotation"} or not definition.formula.names & MOMENTS:
        return False
    machine = sensitivities.fit.machine
    components = ["reading"] if definition.component == "reading" else ["rx", "ry", "rz"]
    whole = [c for x in components if (c := sensitivities.component(effect.place, x)) is not None]
    arm = reach(machine) if machine.measurand.moving else 1.0
    scale = arm * np.sqrt(sum(float(np.sum(c**2)) for c in whole))
    if "F" in definition.formula.names and sensitivities.observations.load is not None:
        scale *= float(np.abs(sensitivities.observations.load).max())
    columns = next(_direct(sensitivities, effect)).columns
    return bool(np.sqrt(np.sum(columns**2, axis=(0, 1))).max(initial=0.0) < SELECTION.weightless * scale)


def _is_wave(effect: Effect) -> bool:
    return list(effect.definition.searched.values()) == [StartSearch.PERIOD]


def _direct(sensitivities: Sensitivities, effect: Effect) -> Iterator[Candidate]:
    """Yield an effect that is in the model itself.

    One with weights at later joints comes without these, with each that has a lever arm, and with all such weights:
    full fits take in those that the data call for, and what these explain is not for another effect, or a form.
    """
    keys = [key for key in sensitivities.index if effect.owns(key)]
    later = [key for key in keys if _is_later_weight(effect, key)]
    keys_at_once = [key for key in keys if key not in later]

    def of(*names: str) -> Candidate:
        return Candidate(
            effect, names, sensitivities.columns[:, :, [sensitivities.index[k] for k in names]], {}
        )

    yield of(*keys_at_once)
    size = {key: float(np.linalg.norm(of(key).columns)) for key in keys}
    later = [key for key in later if size[key] > COST.visible * max(size.values())]
    chosen = [[key] for key in later] + ([later] if len(later) > 1 else [])
    yield from (replace(of(*keys_at_once, *some), tries=float(1 + len(chosen))) for some in chosen)


def _is_later_weight(effect: Effect, key: str) -> bool:
    return effect.definition.later_joints and key.rpartition(".")[2] not in effect.definition.parameters


def with_searched(sensitivities: Sensitivities, effect: Effect, searched: Mapping[str, float]) -> Candidate:
    """Return an effect that is a product, at some values of the parameters that are searched."""
    linear = [name for name in effect.definition.parameters if name not in effect.definition.searched]
    columns = columns_at(sensitivities, effect, {name: [value] for name, value in searched.items()})[0]
    return Candidate(effect, tuple(map(effect.key, linear)), columns, searched)


def columns_at(
    sensitivities: Sensitivities, effect: Effect, searched: Mapping[str, Sequence[float]]
) -> Array:
    """Return the columns of an effect that is a product at several values of what is searched, (values, n, m, k)."""
    linear = [name for name in effect.definition.parameters if name not in effect.definition.searched]
    return np.stack([_column(sensitivities, effect, name, searched) for name in linear], axis=-1)


def promising_periods(
    sensitivities: Sensitivities, effects: Sequence[Effect], others: Sequence[Candidate]
) -> Iterator[tuple[Effect, dict[str, float]]]:
    """Yield waves with the periods that take away most of the residuals, given the model, and given others, too.

    A wave that is hidden by another effect shows once that one is projected out: all others, or those that nearly every
    machine has, such as wrong dimensions; one that another effect could imitate shows given the model alone.
    """
    n, _m = sensitivities.residual.shape
    some = np.unique(np.linspace(0, n - 1, min(n, WAVE_ROWS)).astype(int)) if n > WAVE_ROWS else np.arange(n)
    residual = sensitivities.residual[some].ravel()
    model = sensitivities.model[some].reshape(len(residual), -1)
    bases = [orthonormal_basis(model)]
    once = {c.key: c for c in others}.values()
    for preferred in ([c for c in once if c.prior.log_odds >= 0], once):
        whole = np.concatenate(
            [model, *(c.columns[some].reshape(len(residual), -1) for c in preferred)], axis=1
        )
        if preferred and whole.shape[1] < len(residual) // 2:
            bases.append(orthonormal_basis(whole))
    lefts = [project_out(base, residual) for base in bases]
    for effect in effects:
        tried = list(_tried(sensitivities, effect))
        frequencies = 2 * np.pi / np.array([value for values in tried for value in values.values()])
        sensitivity = sensitivities.component(effect.place, "reading")
        assert sensitivity is not None
        q = sensitivities.observations.q[some, _number(sensitivities, effect)]
        step = float(np.min(np.abs(np.diff(frequencies)), initial=np.inf))
        near = step * np.linspace(-0.5, 0.5, FINER) if np.isfinite(step) else np.zeros(1)
        chosen: dict[float, None] = {}
        for base, left in zip(bases, lefts, strict=True):
            falls = wave_falls(base, left, sensitivity[some], q, frequencies)
            padded = np.pad(falls, 1)
            peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
            best = peaks[np.argsort(-falls[peaks], kind="stable")][:PEAKS]
            finer = frequencies[best, None] + near
            falls = wave_falls(base, left, sensitivity[some], q, finer.ravel()).reshape(finer.shape)
            chosen |= dict.fromkeys(finer[range(len(best)), falls.argmax(axis=1)].tolist())
        (name,) = tried[0]
        for frequency in chosen:
            yield effect, {name: 2 * np.pi / frequency}


def number_tried(rows: FitRows, effect: Effect) -> float:
    """Return the number of independent tests that the values tried for a searched parameter amount to."""
    count = float(len(list(_tried(rows, effect))))
    # Waves half a wave apart count as independent; measured, 117 of them amount to 108 tests.
    # Time constants are much alike: twelve amount to four to six tests (measured), and count as seven.
    return max(count if _is_wave(effect) or count <= 1 else 1 + count / 2, 1.0)


def _tried(sensitivities: FitRows, effect: Effect) -> Iterator[dict[str, float]]:
    """Yield values of the parameters that do not enter linearly."""
    searched = effect.definition.searched
    if not searched:
        yield {}
        return
    (name, search), *more = searched.items()
    if more:
        return
    if search is StartSearch.TIME_CONSTANT:
        t = sensitivities.observations.t
        assert t is not None
        times = np.unique(t)
        for tau in np.geomspace(max(np.diff(times).min(), 1e-3 * np.ptp(times)), 3 * np.ptp(times), TAUS):
            yield {name: float(tau)}
    elif search is StartSearch.PERIOD:
        period = effect.given(sensitivities.fit.machine, name)
        if period is not None:
            yield {name: period}
            return
        j = _number(sensitivities, effect)
        q = np.unique(sensitivities.observations.q[:, j])
        enough = EVIDENCE.positions_a_freedom * len(effect.definition.parameters)
        if positions(q).max(initial=0) + 1 >= enough:
            highest = min(most_waves(q), MOST_WAVES)
            for waves in np.arange(FEWEST_WAVES, highest + WAVES_STEP / 2, WAVES_STEP):
                yield {name: float((q[-1] - q[0]) / waves)}


def _number(sensitivities: FitRows, effect: Effect) -> int:
    return sensitivities.fit.machine.number_of(str(effect.place))


def _column(
    sensitivities: Sensitivities, effect: Effect, name: str, searched: Mapping[str, Sequence[float]]
) -> Array:
    """Return the derivative by one parameter, the other linear ones zero, at searched values, (values, n, m)."""
    definition = effect.definition
    values = {key: np.reshape(several, (-1, 1, 1)) for key, several in searched.items()}
    names = dict.fromkeys(definition.parameters, 0.0) | {name: 1.0} | values
    words = _vocabulary(sensitivities, effect.place)
    if definition.component != "reading" and "q" in words:
        words = words | {"q": sensitivities.observations.coordinates[:, _number(sensitivities, effect)]}
    with np.errstate(all="ignore"):
        change = definition.formula.evaluate(words | names, ARRAY_FUNCTIONS, float)
    count, n = max(map(len, values.values()), default=1), sensitivities.observations.n
    if definition.component == "reading":
        sensitivity = sensitivities.component(effect.place, "reading")
        assert sensitivity is not None
        return np.asarray(sensitivity * np.broadcast_to(change, (count, 1, n))[:, 0, :, None])
    turns = not sensitivities.fit.machine.measurand.moving
    letter = "r" if definition.component == "rotation" or (definition.component == "frame" and turns) else "t"
    change = np.broadcast_to(change, (count, 3, n))
    columns = np.zeros((count, *sensitivities.residual.shape))
    for x, along in zip("xyz", np.swapaxes(change, 0, 1), strict=True):
        sensitivity = sensitivities.component(effect.place, f"{letter}{x}")
        if sensitivity is not None and along.any():
            columns += sensitivity * along[:, :, None]
    return columns


def _vocabulary(sensitivities: Sensitivities, place: Place) -> dict[str, Any]:
    """Return what a formula of the catalogue may use at a place; vectors as columns, (3, 1)."""
    if place not in sensitivities.words:
        sensitivities.words[place] = _words(sensitivities, place)
    return sensitivities.words[place]


def _words(sensitivities: Sensitivities, place: Place) -> dict[str, Any]:
    o, machine = sensitivities.observations, sensitivities.fit.machine
    names: dict[str, Any] = {"pi": np.pi, "t": o.t, "F": o.load}
    names |= {f"E{x}": np.eye(3)[:, [i]] for i, x in enumerate("XYZ")}
    if place is None or machine.kind_of(place) == "target":
        return names
    j = machine.number_of(place)
    names |= {"q": o.q[:, j], "s": o.s[:, j].astype(float), "v": o.v[:, j]}
    names |= {"T": o.temperature.get(place)}
    names |= {"acc": o.covariates.get(f"a_{machine.joints[j].column}")}
    before = machine.carriers(j)
    names |= {"q_before": o.q[:, before[-1]]} if before else {}
    if machine.joints[j].in_loop:
        return names
    axis = sensitivities.fit.problem.model.axis(sensitivities.fit.solution.theta, j)
    u, v = complete_basis(np.array(machine.joints[j].axis))
    names |= {"N": axis[:, None], "U": u[:, None], "V": v[:, None]}
    start, end = sensitivities.fit.problem.model.reach[j]
    if end > start:
        zeta = (o.coordinates[:, j] - start) / (end - start)
        legendre = np.polynomial.legendre.legval(2 * zeta - 1, np.eye(5))
        names |= {"L": end - start, "zeta": zeta} | {f"P{k}": legendre[k] for k in range(1, 5)}
    return names
