"""The outputs of every shipped kernel at 200 points: of the NumPy function, and of the compiled one, to the last bit.

Points are those of `tests/kernel_reference.py`, ordinary and hard ones, and further ones that its functions draw with
other random numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
from kernel_reference import DIRECTIONS, GENERATED, UNITS, inputs_of

from rodgen.generated import numpy as generated
from rodgen.kinematics.backend import backend
from rodgen.kinematics.backend import kernels as in_use

POINTS = 200
ROUNDS = 60


def cases() -> list[str]:
    """Return the names of the kernels."""
    return sorted(GENERATED)


@cache
def points(name: str) -> tuple[np.ndarray, ...]:
    """Return the inputs of a kernel, (200, ...) each."""
    kernel = SimpleNamespace(name=name, inputs=GENERATED[name].inputs)
    draw = np.random.default_rng
    rows: dict[bytes, tuple[np.ndarray, ...]] = {}
    for n in range(ROUNDS):
        with mock.patch.object(np.random, "default_rng", lambda seed, n=n: draw([seed, n] if n else seed)):
            arrays = [np.asarray(a, float) for a in inputs_of(kernel).values()]
        for row in zip(*arrays, strict=True):
            rows.setdefault(b"".join(x.tobytes() for x in row), row)
        if len(rows) >= POINTS:
            break
    found = list(rows.values())
    random = draw(1)
    while len(found) < POINTS:  # where nothing is drawn: points next to these
        found.append(
            tuple(x * (1 + 1e-3 * random.uniform(-1, 1, x.shape)) for x in found[len(found) - len(rows)])
        )
    return tuple(np.stack(column) for column in zip(*found[:POINTS], strict=True))


def outputs(name: str, inputs: tuple[np.ndarray, ...]) -> dict[str, np.ndarray]:
    """Evaluate a kernel, by NumPy and as compiled; a status stays a whole number."""
    found = {}
    functions = {"": getattr(generated.ALL, name)}
    if backend != "numpy":
        functions["compiled "] = getattr(in_use, name)
    with np.errstate(all="ignore"):
        for prefix, function in functions.items():
            results = function(*inputs)
            results = results if isinstance(results, tuple) else (results,)
            for port, result in zip(GENERATED[name].outputs, results, strict=True):
                found[f"{prefix}{port.name}"] = np.asarray(result)
    return found


def answers(case: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the key and the record of a kernel."""
    inputs = points(case)
    arrays = outputs(case, inputs)
    digest = hashlib.sha256(b"".join(np.round(x, 9).tobytes() for x in inputs)).hexdigest()[:16]
    yield case, {"inputs": digest, "arrays": arrays}


def allowance(key: str, name: str, values: np.ndarray) -> np.ndarray:
    """Return how far outputs may be off, by the rule of `tests/kernel_reference.py`.

    That is UNITS times the change by inputs that are moved by the machine epsilon in a few directions; NaN, anything,
    where such a move decides whether there is a value.
    """
    inputs = points(key)
    random = np.random.default_rng(4)
    eps = float(np.finfo(float).eps)
    exact = outputs(key, inputs)[name]
    axes = tuple(range(1, exact.ndim))
    largest = np.max(np.abs(np.where(np.isfinite(exact), exact, 0.0)), axis=axes, keepdims=True, initial=0.0)
    change = np.zeros(exact.shape)
    kinds = np.isfinite(exact)
    unsure = np.zeros(exact.shape, bool)
    with np.errstate(all="ignore"):
        for _ in range(DIRECTIONS):
            moved = tuple(x + eps * _size(x) * random.choice([-1, 1], x.shape) for x in inputs)
            near = outputs(key, moved)[name]
            change = np.fmax(change, np.abs(near - exact))
            unsure |= np.isfinite(near) != kinds
        room = UNITS * (np.max(change, axis=axes, keepdims=True, initial=0.0) + largest * eps / 2)
    return np.where(unsure, np.nan, np.broadcast_to(room, exact.shape))


def _size(x: np.ndarray) -> np.ndarray:
    """Return the largest component of each point, as far as it is finite."""
    finite = np.where(np.isfinite(x), np.abs(x), 0.0)
    return np.max(finite, axis=tuple(range(1, x.ndim)), keepdims=True, initial=0.0)
