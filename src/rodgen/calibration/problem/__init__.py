"""The least-squares problem of a machine and its measurements: bound data, assembly modes, residuals, Jacobian."""

from rodgen.calibration.problem.problem import Problem, one_thread_in_blas

__all__ = ["Problem", "one_thread_in_blas"]
