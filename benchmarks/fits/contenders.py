"""The contenders: a name, and a call that fits from the start and returns the results to be checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fits import driver, formulas, peer_casadi, peer_jax
from fits.cases import Case

OWN, NUMERICAL, EXACT = "rodgen", "numerical Jacobian", "exact Jacobian"
SAME = "exact Jacobian, same driver"
FIT = "rodgen"


@dataclass(frozen=True)
class Contender:
    name: str
    family: str  # OWN, NUMERICAL, EXACT or SAME
    call: Callable[[], np.ndarray | object]  # returns a peer's parameters, or rodgen's Fit
    compile_seconds: float | None = None
    strict: bool = True


def rodgen_fits(case: Case) -> Iterator[Contender]:
    from rodgen.calibration.fit import fit

    def with_deviations():
        found = fit(case.machine, case.observations, compiled=True)
        assert found.estimates
        return found

    def from_table():
        return fit(case.machine, case.data, compiled=True)

    yield Contender(FIT, OWN, lambda: fit(case.machine, case.observations, compiled=True))
    yield Contender("rodgen, standard deviations too", OWN, with_deviations)
    yield Contender("rodgen, from the table of data", OWN, from_table)


def _arrays(case: Case) -> Callable[[np.ndarray], np.ndarray]:
    function, columns, frame = formulas.ARRAYS[case.name], case.columns, case.frame
    return lambda theta: function(theta, columns, frame)


def scipy_fits(case: Case) -> Iterator[Contender]:
    from scipy.optimize import least_squares

    residuals = _arrays(case)
    for method in ("lm", "trf"):
        yield Contender(
            f"SciPy least_squares, {method}",
            NUMERICAL,
            lambda m=method: least_squares(residuals, case.start, method=m, x_scale="jac").x,
        )


def lmfit_fits(case: Case) -> Iterator[Contender]:
    import lmfit

    residuals = _arrays(case)
    names = [f"p{i}" for i in range(len(case.start))]
    parameters = lmfit.create_params(**dict.fromkeys(names, 0.0))

    def of_parameters(given: lmfit.Parameters) -> np.ndarray:
        return residuals(np.array(list(given.valuesdict().values())))

    def call() -> np.ndarray:
        fitter = lmfit.Minimizer(of_parameters, parameters, calc_covar=False)
        return np.array(list(fitter.minimize(method="leastsq").params.valuesdict().values()))

    yield Contender("lmfit, leastsq", NUMERICAL, call)


def _exact(name: str, case: Case, found: driver.Exact, *, strict: bool = True) -> Iterator[Contender]:
    rows = case.observations.n
    same = driver.same_driver(found, rows, case.start)
    yield Contender(f"{name}, rodgen's driver", SAME, same, found.seconds, strict)
    if strict:
        other = driver.scipy_driver(found, case.start, "lm")
        yield Contender(f"{name}, SciPy least_squares, lm", EXACT, other, found.seconds)


def casadi_fits(case: Case) -> Iterator[Contender]:
    yield from _exact("CasADi", case, peer_casadi.exact(case, fast=False))
    yield from _exact("CasADi, -ffast-math", case, peer_casadi.exact(case, fast=True), strict=False)


def jax_fits(case: Case) -> Iterator[Contender]:
    yield from _exact("JAX", case, peer_jax.exact(case))


FAMILIES: tuple[Callable[[Case], Iterator[Contender]], ...] = (
    rodgen_fits,
    scipy_fits,
    lmfit_fits,
    casadi_fits,
    jax_fits,
)
