"""Which effects the data would not show, whether they are there or not, though other data would."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.determinacy.undetermined import Elsewhere
from rodgen.calibration.open_questions import OpenQuestions
from rodgen.calibration.problem import Problem
from rodgen.calibration.words import NAMES
from rodgen.errors import RodgenError, joined
from rodgen.machines.model import Model
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.machines.machine import Effect


NO_CHANGE = 1e-9
"""A parameter that changes readings by less than this part of what another one does is rounding."""
LOOKED_AT = 12
"""Of this many effects it is found out whether they are a mere choice of coordinates; each takes a model of its own."""


def invisible_effects(questions: OpenQuestions) -> Iterator[str]:
    """Yield a sentence on the effects that the data would not show, if there are any."""
    named = {e.identity for each in questions.alternatives for e in each}
    named |= {e.identity for e in questions.final.machine.effects}
    unseen = [e for e in questions.invisible if e.identity not in named]
    unseen = [e for e in unseen[:LOOKED_AT] if not _is_choice(questions.base, e)] + unseen[LOOKED_AT:]
    if unseen:
        first = unseen[0]
        key = first.name if first.place is None else f"{first.place}.{first.name}"
        these = "it" if len(unseen) == 1 else "the first"
        yield (
            f"Not visible in these data, whether present or not: {joined([e.title for e in unseen], most=NAMES)} "
            f"(--for {key} plans for {these})."
        )


def _is_choice(fit: FittedModel, effect: Effect) -> bool:
    """Return whether the model imitates an effect in any measurement: it is a mere choice of coordinates."""
    o = fit.observations
    try:
        machine = fit.machine.with_effect(effect)
        problem = Problem(Model(machine, fit.problem.model.travel, o.run_names, compiled=False), o)
    except RodgenError:
        return True
    parameters = problem.model.parameters
    known = dict(zip((p.key for p in fit.parameters), fit.solution.theta, strict=True))
    start = zip(parameters, problem.model.start(), strict=True)
    theta = np.array([known.get(p.key, x) for p, x in start])
    own = [i for i, p in enumerate(parameters) if p.key not in known and not p.searched]
    free = {fit.parameters[i].key for i in fit.free}
    index = np.array([i for i, p in enumerate(parameters) if p.key in free or i in own], int)
    with np.errstate(all="ignore"):
        there = Elsewhere.of(problem, theta, fit.solution.frame, index)
    mine = np.isin(index, own)
    return all(_imitated(jacobian, mine) for jacobian in (there.jacobian, there.of_others))


def _imitated(jacobian: Array, mine: NDArray[np.bool_]) -> bool:
    """Return whether some columns are combinations of the others, but for a small part."""
    size = np.linalg.norm(jacobian, axis=0)
    known = size > NO_CHANGE * size.max(initial=0.0)
    own = unit_columns(jacobian[:, mine & known])
    rest = ColumnSpace.of(jacobian[:, ~mine & known]).project_out(own)
    return bool(np.all(np.linalg.norm(rest, axis=0) <= SELECTION.visible))
