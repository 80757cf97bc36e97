"""Tasks for processes, in a module of their own: what starts a process imports no more than this."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def squared_unless_killed(number: int) -> tuple[int, int]:
    """Return the square and the number of the process; at 3 it is killed, as for lack of memory."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2, os.getpid()


def slept(file: str) -> None:
    """Write the number of the process into a file, and sleep for minutes."""
    Path(file).write_text(str(os.getpid()))
    time.sleep(300)
