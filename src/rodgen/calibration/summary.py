"""What a fit says, as a document and as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import starmap
from typing import Any

import numpy as np

from rodgen.calibration.decidability import held_at_bounds, why_wrong_geometry
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.gross_readings import on_gross_readings, on_outliers
from rodgen.calibration.pointing import pointing
from rodgen.calibration.problem.assembly_modes import in_another_mode, other_mode
from rodgen.calibration.words import NOTHING_LEFT, capitalized, chance
from rodgen.document import Block, Document, Paragraph, Part, Table
from rodgen.errors import counted, joined
from rodgen.statistics.thresholds import LACK_OF_FIT
from rodgen.views import plain

LATE = 0.05
"""Part of the measurement's duration by which its time may begin before or after 0 without a remark."""
CONVENTION = (
    "* A choice of coordinates is in this value: others, with other values of more parameters, predict the same. The "
    "one nearest to the machine file is shown, and the std is that of this choice."
)
TOLD = 1e-3
"""Part of a prior's variance that readings take away at least to say anything of it: rounding takes less."""
NAMED = 8
"""Parameters that a sentence names; the rest is counted."""


def geometry(fit: Fit) -> dict[str, dict[str, list[float]]]:
    """Return the fitted axes, points, targets and frame as vectors, in the machine file's length unit."""
    model, theta = fit.problem.model, fit.solution.theta
    numbers: dict[str, dict[str, list[float]]] = {}
    for name in model.structure.numbers:
        numbers.setdefault("geometry", {})[name] = list(model.number(theta, name))
    for j, joint in enumerate(fit.machine.joints):
        structure = model.structure.joints[j]
        if structure.axis:
            numbers.setdefault(joint.name, {})["axis"] = model.axis(theta, j).tolist()
        if structure.point:
            numbers.setdefault(joint.name, {})["point"] = model.point(theta, j).tolist()
    if model.structure.target:
        for k, target in enumerate(fit.machine.targets):
            numbers.setdefault("targets", {})[target.name] = model.target(theta, k).tolist()
    if model.structure.frame:
        numbers["frame"] = {
            "rotation": fit.solution.frame.rotation.tolist(),
            "position": fit.solution.frame.position.tolist(),
        }
    return numbers


def as_dict(fit: Fit) -> dict[str, Any]:
    """Return what `rodgen fit --json` prints."""
    return {
        **plain(fit, "machine=machine.name data=observations.data.file"),
        **fit.used_rows,
        "readings": fit.problem.count * fit.problem.components,
        **plain(fit, "converged=solution.converged rms unit"),
        **_of_poses(fit),
        **plain(fit, "chi_square degrees_of_freedom prior_chi_square noise lack_of_fit dependence"),
        **plain(fit, "parameters=estimates"),
        "geometry": geometry(fit),
        **plain(fit, "held_out_geometry"),
        **({"pointing": on_sky.to_dict()} if (on_sky := pointing(fit)) else {}),
        "undetermined": [
            {"parts": dict(d.parts), "gauge": d.gauge, "text": d.text} for d in fit.determinacy.directions
        ],
        "held_near_the_file": list(fit.determinacy.held),
        "weak": [{"parts": dict(d.parts), "text": d.text} for d in fit.determinacy.weak],
    }


def _of_poses(fit: Fit) -> dict[str, Any]:
    """Return the errors of positions and attitudes, and the arm by which these are lengths; empty of other readings."""
    if fit.errors is None:
        return {}
    place, turn = fit.errors
    return {"rms_of_positions": place, "rms_of_attitudes": turn, "unit_of_attitudes": fit.units[-1],
            "arm": fit.observations.arm}  # fmt: skip


def document(fit: Fit) -> Document:
    """Return what `rodgen fit` prints."""
    readings = fit.problem.count * fit.problem.components
    counts = [(fit.problem.count, "row"), (readings, "reading"), (len(fit.free), "parameter")]
    title = f"{fit.machine.name}: " + ", ".join(starmap(counted, counts))
    return Document([*_said(_sentences(fit)), *_parts(fit)], title)


def _said(sentences: Iterable[str]) -> list[Block]:
    return [Paragraph(text, "line") for text in sentences if text]


def _sentences(fit: Fit) -> Iterator[str]:
    yield from fit.observations.on_rows
    if not fit.solution.converged:
        yield "NOT CONVERGED: the numbers below are where the fit stopped."
        yield why_wrong_geometry(fit) or ""
    yield on_gross_readings(fit)
    yield from contradictions(fit)
    yield f"{fit.error_text}. {fit.noise.text}"
    if fit.degrees_of_freedom < 1:
        yield NOTHING_LEFT
    elif fit.lack_of_fit and fit.solution.converged:
        yield fit.lack_of_fit.text
    yield on_outliers(fit, fit.outliers)
    if fit.held_out_geometry and fit.held_out_geometry.lowers is False:
        yield fit.held_out_geometry.text
    yield from _warnings(fit)


def _parts(fit: Fit) -> Iterator[Part]:
    estimates = [e for e in fit.estimates.values() if not e.held or e.value]
    if estimates:
        more = [fit.dependence.text] if any(e.std is not None for e in estimates) else []
        more += [CONVENTION] if any(e.convention for e in estimates) else []
        yield Part([_table(estimates), *_said(more)])
    if on_sky := pointing(fit):
        terms = _table([*on_sky.terms.values()], "TPOINT's term")
        yield Part([*_said([on_sky.sentence()]), terms])
    if fit.determinacy.held:
        hardly = (
            f"These data hardly determine {joined(fit.determinacy.held, most=NAMED)}: along their combinations the fit "
            "stays as near to the machine file as a machine is to its file (3 degrees, 5 % of its size, effects a "
            "tenth), and the std counts on that."
        )
        yield Part(_said([hardly]))
    directions = (*fit.determinacy.directions, *fit.determinacy.weak)
    if directions:
        yield Part(_said(d.text for d in directions))


def _warnings(fit: Fit) -> Iterator[str]:
    """Yield what may be meant otherwise than it is taken."""
    t = fit.observations.t
    if t is not None and any(effect.name == "warm_up_drift" for effect in fit.machine.effects):
        first, span = float(t.min()), float(np.ptp(t))
        if abs(first) > LATE * span:
            yield f"t begins at {first:.6g} s: warm_up_drift counts from t = 0, when the machine was cold."
    yield from _about_modes(fit)


def _priors(fit: Fit) -> list[int]:
    return [i for i in fit.free if fit.parameters[i].prior is not None]


def contradictions(fit: Fit) -> Iterator[str]:
    """Yield sentences on priors and bounds of the machine file that the readings contradict."""
    if priors := _priors(fit):
        yield from _against_priors(fit, priors)
    if fit.without_bounds is not None:
        yield held_at_bounds(fit, fit.without_bounds)


def _against_priors(fit: Fit, priors: list[int]) -> Iterator[str]:
    """Yield a sentence where priors and readings differ by more than both allow.

    A fit is off a prior of variance P by P/(P + D) of what the readings, of variance D, say; the variance of that is P
    less the variance of the fit. The largest difference counts, of as many as there are priors.
    """
    from scipy import special

    precision = fit.problem.file_values.precision[priors]
    off = (fit.solution.theta[priors] - fit.problem.file_values.centre[priors]) * precision
    variances = fit.independent_covariance[priors, priors]
    variance = 1 - precision**2 * variances
    sizes = np.where(variance > TOLD, np.abs(off) / np.sqrt(np.maximum(variance, TOLD)), 0.0)
    worst = int(np.argmax(np.nan_to_num(sizes)))
    p = len(priors) * float(special.chdtrc(1, sizes[worst] ** 2))
    if p < LACK_OF_FIT.rare:
        yield (
            f"The readings contradict the priors of the machine file ({chance(p)}): the two differ by "
            f"{sizes[worst]:.3g} standard deviations in {fit.parameters[priors[worst]].key}, the most."
        )


def _about_modes(fit: Fit) -> Iterator[str]:
    asked, written = fit.problem.model.machine, fit.machine
    if mode := other_mode(fit.observations, asked):
        yield f"{capitalized(mode)}: leave start out, or check the order of the legs."
    elif asked.kinematics.start is None:
        share = in_another_mode(fit.observations, written)
        if share > 0:
            yield (
                f"In {share:.1%} of the rows the platform is in another assembly mode than in most: what is written "
                "with the fitted numbers has the mode of most, and predicts the others wrongly."
            )


def _table(estimates: list[Estimate], title: str = "parameter") -> Table:
    """Return the parameters."""
    rows = []
    for e in estimates:
        value, spread, unit = e.shown
        if e.held:
            spread = "held"
        elif e.at_bound:
            spread = "at bound"
        elif e.std is None and e.determined:
            spread = "unknown"  # no more readings than parameters: the noise is not known
        elif e.std is None:
            spread = "undetermined"
        tied = f"  = {e.tied_to}" if e.tied_to else ""
        rows.append((e.key, value, spread + "*" * e.convention, f"{unit}{tied}"))
    return Table((title, "value", "std", "unit"), rows, "lrrl")
