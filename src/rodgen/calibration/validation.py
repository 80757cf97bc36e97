"""The error of a fitted machine on further measurements, which it was not fitted to."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.solve.least_squares import minimise
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Rms
    from rodgen.calibration.fit import Fit

CHANGED = 2.0
"""Times that on poses left out from which on the error on further measurements is explained: by chance it is larger
by a fifth, and where these go beyond the others, by a half."""


def bind_validation(machine: Machine, test: Any) -> Observations:
    """Bind further measurements to a machine, and refuse those on which its error cannot be computed.

    Raises
    ------
    InputFileError
    """
    others = bind_once(machine, test)
    Problem(Model(machine, others.travel, others.run_names, compiled=False), others)  # has all columns
    return others


def validation_error(validated: Fit, others: Observations) -> float:
    """Return the error on further measurements, to which only the frame is fitted, where it is free.

    Raises
    ------
    InputFileError
        When a column is not there that an effect needs.
    """
    model = Model(validated.machine, validated.problem.model.travel, others.run_names, compiled=False)
    problem = Problem(model, others)
    theta = model.start()
    frame = Frame.fitted(validated.machine.values) or Frame.identity()
    free = [i for i, p in enumerate(model.parameters) if p.slot[0] == "frame"]
    solution = minimise(problem, theta, frame, free)
    no_outliers = np.zeros(others.n, bool)
    return replace(
        validated, observations=others, problem=problem, solution=solution, outliers=no_outliers
    ).rms


def on_another_machine(rms: Rms) -> str:
    """Return a sentence where the error on further measurements is far larger than that on poses left out; else empty.

    Parameters
    ----------
    rms : Rms
        With the errors on further measurements.
    """
    if rms.after_test is None or not rms.after_held_out or rms.after_test < CHANGED * rms.after_held_out:
        return ""
    return (
        f"The error on the further measurements is {rms.after_test / rms.after_held_out:.2g} times that on poses left "
        "out: the machine, its targets or the set-up were others then, as after a correction, or something acts there "
        "that the model lacks."
    )
