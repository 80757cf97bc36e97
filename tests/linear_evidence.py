"""The evidence of readings and columns that a test makes up, in the place of a fit's."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Columns, Evidence, Space


def evidence_of(
    found: Sequence[Candidate], readings: np.ndarray, model: np.ndarray | None = None, base: Any = None
) -> Evidence:
    """Return the evidence of independent readings, (n,) or (n, m), of which a constant is fitted, or a model."""
    y = readings.reshape(len(readings), -1)
    model = np.ones((*y.shape, 1)) if model is None else model.reshape(*y.shape, -1)
    flat, none = model.reshape(y.size, -1), np.zeros((y.size, 0))
    space, of_no_joint = Space.of(flat, y.ravel(), y.ravel(), 0.0), SimpleNamespace(v=np.zeros((len(y), 0)))
    empty = Evidence(
        base=base,
        sensitivities=SimpleNamespace(  # type: ignore[arg-type]
            residual=y, model=model, observations=of_no_joint, exact=frozenset()
        ),
        correlation=SimpleNamespace(whiten=lambda columns: columns),  # type: ignore[arg-type]
        candidates=[],
        unseen=[],
        unusable=[],
        dof=y.size - flat.shape[1],
        models=[Columns.of(space, none)],
        parts={},
        shares={},
    )
    return empty.including(list(found))
