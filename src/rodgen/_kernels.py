"""Where the public functions take their kernels from: the compiled gufuncs, or NumPy where there are none.

Set ``RODGEN_CPU`` to ``numpy``, ``baseline`` or ``avx2`` before the import to use less than the processor has;
that is for tests and comparisons.
"""

from __future__ import annotations

import os
import warnings
from typing import Any

__all__ = ["backend", "kernels"]


def _load() -> tuple[str, Any]:
    if os.environ.get("RODGEN_CPU") != "numpy":
        try:
            from rodgen import _gufuncs  # type: ignore[attr-defined]

            return _gufuncs.instruction_set, _gufuncs
        except ImportError as error:
            warnings.warn(
                f"rodgen has no compiled kernels and runs on NumPy, which is slower ({error}); "
                "install a C compiler and rodgen again",
                RuntimeWarning,
                stacklevel=2,
            )
    from rodgen.generated import numpy as generated

    return "numpy", generated.ALL


backend, kernels = _load()
"""Instruction set of the kernels in use (``avx512``, ``avx2``, ``baseline`` or ``numpy``), and the kernels."""
