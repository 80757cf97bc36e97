"""Decompositions end in a result where NumPy's drivers do not converge."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rodgen.statistics.columns import orthonormal_basis
from rodgen.statistics.decompositions import eigh, lstsq, svd

SOURCE = Path(__file__).parent.parent / "src" / "rodgen"
SHAPES = ((5, 3), (3, 5), (4, 4), (2, 3, 6, 4), (0, 3), (3, 0))


@pytest.fixture
def stubborn(monkeypatch):
    """NumPy, whose decompositions do not converge."""

    def refuse(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    for name in ("svd", "lstsq", "eigh"):
        monkeypatch.setattr(np.linalg, name, refuse)


def deficient(shape):
    """Return a matrix of rank 2 at most."""
    rng = np.random.default_rng(3)
    *stack, m, n = shape
    return rng.standard_normal((*stack, m, 2)) @ rng.standard_normal((*stack, 2, n))


@pytest.mark.parametrize("shape", SHAPES[:4])
@pytest.mark.parametrize("full", [False, True])
def test_svd_by_the_other_driver(shape, full, stubborn):
    a = deficient(shape)
    u, s, vt = svd(a, full_matrices=full)
    k = min(shape[-2:])
    assert u.shape[-2:] == (shape[-2], shape[-2] if full else k)
    assert vt.shape[-2:] == (shape[-1] if full else k, shape[-1])
    assert np.allclose((u[..., :k] * s[..., None, :]) @ vt[..., :k, :], a, rtol=0, atol=1e-13)
    assert np.all(np.diff(s, axis=-1) <= 0)


def test_eigenvalues_and_least_squares_by_the_other_driver(stubborn):
    a = deficient((6, 4))
    values, vectors = eigh(a.T @ a)
    assert np.all(np.diff(values) >= 0)
    assert np.allclose((vectors * values) @ vectors.T, a.T @ a, rtol=0, atol=1e-13)
    # the shortest of all solutions: it has no part that changes nothing
    right = np.arange(6.0)
    x = lstsq(a, right, relative=1e-9)
    assert np.allclose(a.T @ (a @ x - right), 0, rtol=0, atol=1e-12)
    assert np.linalg.norm(x) == pytest.approx(np.linalg.norm(vectors[:, 2:].T @ x), rel=1e-12)
    assert lstsq(a, np.eye(6), relative=1e-9).shape == (4, 6)


def test_a_basis_of_columns_without_convergence(stubborn):
    assert orthonormal_basis(deficient((50, 8))).shape == (50, 2)


def test_what_is_not_finite_is_an_error():
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        svd(np.array([[1.0, np.nan], [0.0, 1.0]]))


def test_statistics_and_calibration_decompose_in_one_place():
    direct = re.compile(r"np\.linalg\.(svd|lstsq|pinv|eigh)\(")
    for package in ("statistics", "calibration"):
        for file in sorted((SOURCE / package).rglob("*.py")):
            assert file.name == "decompositions.py" or not direct.search(file.read_text()), file
