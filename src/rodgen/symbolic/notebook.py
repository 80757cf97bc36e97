"""Whether a notebook runs this code: only then does a derivation draw its figures."""

from __future__ import annotations

import sys


def in_notebook() -> bool:
    """Return whether a Jupyter kernel runs this code; IPython is not imported to find out."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return running is not None and "IPKernelApp" in running.config
