"""Estimates of an effect's parameters, with standard deviations that allow for correlated readings."""

from __future__ import annotations

import numpy as np

from rodgen.calibration.fitted import Estimate, Fit
from rodgen.machines.machine import Effect
from rodgen.statistics.columns import inverse_root


class EffectEstimates:
    """The estimates of a fit's parameters, with standard deviations that allow for correlated readings."""

    def __init__(self, final: Fit) -> None:
        self.final = final
        self.covariance = final.covariance

    def of(self, effect: Effect) -> dict[str, Estimate]:
        """Return the parameters of an effect by their short names.

        Those of set-ups are relative to the first one where only their differences are determined.
        """
        numbers = self._numbers(effect)
        first = {self.final.parameters[i].slot[2]: i for i in reversed(numbers) if self._is_shift(i)}
        relative = bool(first) and any(self.final.determinacy.undetermined[i] for i in numbers)
        found = {}
        for i in numbers:
            parameter = self.final.parameters[i]
            name = parameter.key[len(effect.key("")) :].removeprefix(".")
            if relative:
                start = first[parameter.slot[2]]
                if i != start:
                    found[name] = self._difference(i, start)
                continue
            found[name] = self.final.estimates[parameter.key]
        return found

    def _numbers(self, effect: Effect) -> list[int]:
        return [
            i
            for i, parameter in enumerate(self.final.parameters)
            if effect.owns(parameter.key) and not (parameter.optional and i not in self.final.free)
        ]

    def _is_shift(self, i: int) -> bool:
        return self.final.parameters[i].slot[0] == "shift" and "[" in self.final.parameters[i].key

    def _difference(self, i: int, start: int) -> Estimate:
        parameter, C = self.final.parameters[i], self.covariance
        variance = C[i, i] + C[start, start] - 2 * C[i, start]
        value = (self.final.values[i] - self.final.values[start]) / parameter.factor
        std = float(np.sqrt(max(variance, 0.0)) / parameter.factor)
        return Estimate(parameter.key, parameter.unit, float(value), std, False, True)

    def significance(self, effect: Effect) -> float:
        """Return the p-value of an effect, by Wald's test of the hypothesis that all its parameters are zero."""
        from scipy import special

        final = self.final
        searched = [p.searched for p in final.parameters]
        numbers = [i for i in self._numbers(effect) if i in final.free and not searched[i]]
        if not numbers or any(self._is_shift(i) for i in numbers):
            return 0.0
        C = self.covariance[np.ix_(numbers, numbers)]
        size = np.sqrt(np.maximum(np.diag(C), 1e-300))
        along = inverse_root(C / np.outer(size, size), relative=1e-12).T @ (final.values[numbers] / size)
        return float(special.chdtrc(len(along), float(along @ along)))
