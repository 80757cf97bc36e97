"""Tasks for processes, in a module of their own: what starts a process imports no more than this."""

from __future__ import annotations

import os
import signal
import time


def squared_unless_killed(number: int) -> int:
    """Return the square; at 3 the process is killed, as for lack of memory."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def process_after(seconds: float) -> int:
    """Return the number of the process that has waited."""
    time.sleep(seconds)
    return os.getpid()
