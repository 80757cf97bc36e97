"""Every effect of the catalogue, at every place, as the columns that it adds to a fit's derivative."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy._start import most_waves
from rodgen.discrepancy.diagnose._carriers import Carriers, is_direct
from rodgen.machines._rigid import complete_basis
from rodgen.machines.machine import Effect

__all__ = ["Candidate", "candidates"]

Array: TypeAlias = NDArray[np.float64]

TAUS = 12
"""Time constants that are tried, from the time between two poses to three times the whole."""
WAVES_STEP = 0.5
"""Periods that are tried: as many waves over the way, and so on in these steps."""
MOST_WAVES = 60.0
"""More waves than so many are tried only where the machine file gives the period."""
FEWEST_WAVES = 0.75
FUNCTIONS = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "exp": np.exp,
    "log": np.log, "sqrt": np.sqrt, "abs": np.abs, "sign": np.sign,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect and its columns.

    Attributes
    ----------
    effect : Effect
    names : tuple of str
        Keys of the parameters.
    columns : ndarray, shape (n, m, k)
        Derivative of the weighted residuals by each.
    searched : mapping of str to float
        Values of the parameters that are searched, at which the columns are taken; internal units.
    """

    effect: Effect
    names: tuple[str, ...]
    columns: Array
    searched: Mapping[str, float]

    @property
    def key(self) -> tuple[str, str | None]:
        """Name and place of the effect."""
        return self.effect.name, self.effect.place


def candidates(carriers: Carriers, effects: list[Effect]) -> Iterator[Candidate]:
    """Yield the columns of effects; one that has a searched parameter comes once for each value that is tried.

    Parameters
    ----------
    carriers : Carriers
        Made with these effects.
    effects : list of Effect
    """
    for effect in effects:
        if is_direct(effect):
            keys = [key for key in carriers.index if _is_of(key, effect)]
            found = carriers.columns[:, :, [carriers.index[key] for key in keys]]
            yield Candidate(effect, tuple(keys), found, {})
            continue
        linear = [name for name in effect.definition.parameters if name not in _nonlinear(effect)]
        for searched in _tried(carriers, effect):
            columns = [_column(carriers, effect, {name: 1.0}, searched) for name in linear]
            yield Candidate(effect, tuple(map(effect.key, linear)), np.stack(columns, axis=-1), searched)


def _is_of(key: str, effect: Effect) -> bool:
    prefix = effect.key("")
    return key.startswith((f"{prefix}.", f"{prefix}["))


def _nonlinear(effect: Effect) -> frozenset[str]:
    inner = effect.definition.formula.inner_names
    return frozenset(name for name in effect.definition.parameters if name in inner)


def _tried(carriers: Carriers, effect: Effect) -> Iterator[dict[str, float]]:
    """Yield values of the parameters that do not enter linearly."""
    names = _nonlinear(effect)
    if not names:
        yield {}
    elif names == {"tau"}:
        t = carriers.observations.t
        assert t is not None
        times = np.unique(t)
        for tau in np.geomspace(max(np.diff(times).min(), 1e-3 * np.ptp(times)), 3 * np.ptp(times), TAUS):
            yield {"tau": float(tau)}
    elif names == {"P"}:
        joint = carriers.fit.machine.joint(str(effect.place))
        if joint.period is not None:
            yield {"P": joint.period}
            return
        j = _number(carriers, effect)
        q = np.unique(carriers.observations.q[:, j])
        if len(q) > 3:
            highest = min(most_waves(q), MOST_WAVES)
            for waves in np.arange(FEWEST_WAVES, highest + WAVES_STEP / 2, WAVES_STEP):
                yield {"P": float((q[-1] - q[0]) / waves)}


def _number(carriers: Carriers, effect: Effect) -> int:
    return [joint.name for joint in carriers.fit.machine.joints].index(str(effect.place))


def _column(
    carriers: Carriers, effect: Effect, values: Mapping[str, float], searched: Mapping[str, float]
) -> Array:
    """Return the derivative in the direction of some values of the parameters, the others zero, (n, m)."""
    definition = effect.definition
    names = dict.fromkeys(definition.parameters, 0.0) | dict(values) | dict(searched)
    with np.errstate(all="ignore"):
        change = definition.formula.evaluate(_vocabulary(carriers, effect) | names, FUNCTIONS, float)
    n = carriers.observations.n
    if definition.component == "reading":
        carrier = carriers.component(effect.place, "reading")
        assert carrier is not None
        return np.asarray(carrier * np.broadcast_to(change, n)[:, None])
    turns = carriers.fit.machine.measured.kind == "direction"
    letter = "r" if definition.component == "rotation" or (definition.component == "frame" and turns) else "t"
    change = np.broadcast_to(change, (3, n))
    found = np.zeros(carriers.residual.shape)
    for x, along in zip("xyz", change, strict=True):
        carrier = carriers.component(effect.place, f"{letter}{x}")
        if carrier is not None and along.any():
            found += carrier * along[:, None]
    return found


def _vocabulary(carriers: Carriers, effect: Effect) -> dict[str, Any]:
    """Return what a formula of the catalogue may use; vectors as columns, (3, 1)."""
    o, machine = carriers.observations, carriers.fit.machine
    names: dict[str, Any] = {"pi": np.pi, "t": o.t, "F": o.load}
    names |= {f"E{x}": np.eye(3)[:, [i]] for i, x in enumerate("XYZ")}
    if effect.place is None or machine.kind_of(effect.place) == "target":
        return names
    j = _number(carriers, effect)
    axis = carriers.fit.problem.model.axis(carriers.fit.solution.theta, j)[0]
    u, v = complete_basis(np.array(machine.joints[j].axis))
    names |= {"q": o.q[:, j], "s": o.s[:, j].astype(float), "v": o.v[:, j]}
    names |= {"T": o.temperature.get(str(effect.place)), "N": axis[:, None], "U": u[:, None], "V": v[:, None]}
    start, end = carriers.fit.problem.model.travel[j]
    if end > start:
        zeta = (o.q[:, j] - start) / (end - start)
        legendre = np.polynomial.legendre.legvander(2 * zeta - 1, 4).T
        names |= {"L": end - start, "zeta": zeta} | {f"P{k}": legendre[k] for k in range(1, 5)}
    return names
