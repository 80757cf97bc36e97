"""Processes of this computer that work on tasks one after the other, and whose end is no more than one task's."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

ATTEMPTS = 2
"""Times that a task is tried whose process is killed: once may be the fault of another that needed the memory."""


def each_in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], count: int
) -> Iterator[tuple[int, Result | None]]:
    """Yield the number of an item and what a function returns for it, each as soon as it is done.

    A process keeps what it has imported and compiled for the items that follow.

    Parameters
    ----------
    function : callable
        Of a module, which raises nothing.
    items : sequence
    count : int
        Processes at most.

    Yields
    ------
    (int, result or None)
        None where the process of the item was killed, each time.
    """
    waiting = deque((number, 1) for number in range(len(items)))
    busy: dict[Connection, tuple[BaseProcess, int, int]] = {}
    ended: list[BaseProcess] = []

    def begin(connection: Connection, process: BaseProcess) -> None:
        if waiting:
            number, attempt = waiting.popleft()
            busy[connection] = process, number, attempt
            with contextlib.suppress(OSError):  # of a process that was just killed: reading finds that
                connection.send(items[number])
        else:
            connection.close()  # it ends
            ended.append(process)

    try:
        while waiting or busy:
            while waiting and len(busy) < count:
                begin(*_started(function))
            for connection in wait([*busy]):
                assert isinstance(connection, Connection)
                process, number, attempt = busy.pop(connection)
                try:
                    answer = connection.recv()
                except (EOFError, OSError):
                    process.join()
                    if attempt < ATTEMPTS:
                        waiting.append((number, attempt + 1))
                    else:
                        yield number, None
                else:
                    begin(connection, process)
                    yield number, answer
    finally:
        for process, _, _ in busy.values():
            process.kill()
            ended.append(process)
        for process in ended:  # so that their time counts
            process.join()


def _started(function: Callable[[Any], Any]) -> tuple[Connection, BaseProcess]:
    """Return the connection to a new process, and it."""
    context = multiprocessing.get_context("spawn")  # a fork of a program with threads may hang
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, function), daemon=True)
    process.start()
    there.close()  # so that the end of the process is the end of the connection
    return here, process


def _serve(connection: Connection, function: Callable[[Any], Any]) -> None:
    """Answer items until the other end closes, or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, which ends this process
    while True:
        try:
            connection.send(function(connection.recv()))
        except (EOFError, OSError):
            return
