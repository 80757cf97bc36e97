"""Where independent tasks run: threads of this program, processes of this computer, or the workers of a Dask scheduler.

Tasks are calls of one function with few bytes as arguments and few as results; what they work on they read themselves.
A task whose worker was killed runs again on another one. Dask is imported only where its schedulers are asked for, or
active already.
"""

from __future__ import annotations

import concurrent.futures
import logging
import multiprocessing
import os
import queue
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from rodgen.errors import RodgenError, shown
from rodgen.stages import stage, step

Item = TypeVar("Item")
Result = TypeVar("Result")

ANSWERS_WITHIN = 10
"""Seconds within which a scheduler must answer."""
ATTEMPTS = 2
"""Times that `local_processes` try a task whose process is killed: once may be the fault of another's memory."""
EXPECTED = "threads, processes, either with =N for N of them, or the address of a Dask scheduler: tcp://localhost:8786"


class SchedulerError(RodgenError):
    """A scheduler that cannot be used, in one sentence."""


class Workers:
    """What runs tasks.

    Parameters
    ----------
    submit : callable
        Of an executor; None of Dask.
    client : distributed.Client, optional
        The Dask client, None of threads and of processes without Dask.
    """

    address: str | None = None
    """By which `workers` were asked for them."""

    def __init__(self, submit: Callable[..., Any] | None, client: Any = None) -> None:
        self._submit, self.client = submit, client

    def hold(self, items: Sequence[Item]) -> Sequence[Any]:
        """Return the items for `each`, which then calls functions of an item where it was called before.

        So what an item loads and keeps for itself is there. On another worker, where one was killed, it is a new copy.
        """
        return items if self.client is None else self.client.map(_itself, items, pure=False)

    def each(
        self,
        what: str,
        function: Callable[..., Result],
        items: Sequence[Item],
        *common: Any,
        of_killed: Callable[[int], Result] | None = None,
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of an item and what a function returns for it, each as soon as it is done.

        Parameters
        ----------
        what : str
            Name of the stage; each item is a step of it.
        function : callable
            Of an item and what all have in common. It may run more than once for an item, where a worker was killed.
        *common
            Further arguments.
        of_killed : callable, optional
            Of the number of an item, whose workers were killed several times: what to yield for it.

        Raises
        ------
        SchedulerError
            When workers that ran one task were killed several times, without `of_killed`.
        Exception
            What the function raises; the other tasks are then cancelled.
        """
        killed: type[Exception] = BrokenProcessPool
        coming: Any = concurrent.futures.as_completed
        if self._submit is not None:
            futures = {self._submit(function, item, *common): k for k, item in enumerate(items)}
        else:
            import distributed
            from distributed.scheduler import KilledWorker

            coming, killed = distributed.as_completed, KilledWorker
            # scattered, what is common would be lost with the worker that has it: it travels with the tasks
            call = partial(_called, function, common)
            futures = {each: k for k, each in enumerate(self.client.map(call, items, pure=False))}
        with stage(what, len(items)):
            try:
                for done, future in enumerate(coming(list(futures)), 1):
                    number = futures.pop(future)  # so that each result is let go as soon as it is here
                    try:
                        result: Result = future.result()
                    except killed as error:
                        if of_killed is None:
                            times = getattr(error, "allowed_failures", 1) + 1
                            raise SchedulerError(
                                f"workers of the scheduler were killed {times} times by one task; "
                                "expected workers with more memory, or smaller parts of the work"
                            ) from None
                        result = of_killed(number)
                    step(done)
                    yield number, result
            finally:
                for future in futures:
                    future.cancel()


def _itself(item: Item) -> Item:
    return item


def _called(function: Callable[..., Result], common: tuple[Any, ...], item: Any) -> Result:
    return function(item, *common)


_active: ContextVar[Workers | None] = ContextVar("workers", default=None)


@contextmanager
def workers(address: str | None = None) -> Iterator[Workers]:
    """Return a context with the workers on which tasks run; within it these are those of `workers()`, too.

    Parameters
    ----------
    address : str, optional
        ``"tcp://host:port"`` of a Dask scheduler, ``"processes"`` or ``"processes=4"`` for Dask workers that are
        started on this computer and end with the context, ``"threads"`` or ``"threads=4"``. Left out: the workers of
        the context around, of the Dask client that is active, or threads. The address of the context around stands
        for its workers.

    Raises
    ------
    SchedulerError
        When it is none of these, Dask is not installed, or the scheduler does not answer.

    Examples
    --------
    >>> with workers("threads=2") as some:
    ...     print(sorted(some.each("squaring", pow, [3, 4], 2)))
    [(0, 9), (1, 16)]
    """
    around = _active.get()
    if around is not None and address in (None, around.address):
        yield around
        return
    with _made(address) as scheduler:
        scheduler.address = address
        before = _active.set(scheduler)
        try:
            yield scheduler
        finally:
            _active.reset(before)


@contextmanager
def _made(address: str | None) -> Iterator[Workers]:
    client = _active_client() if address is None else None
    if client is not None:
        yield Workers(None, client)
        return
    kind = re.fullmatch(r"(threads|processes)(?:=([1-9]\d{0,3}))?", address or "threads")
    if kind is None and "://" not in (address or ""):
        raise SchedulerError(f"scheduler {shown(address)}; expected {EXPECTED}")
    if kind is None:
        with _connected(str(address)) as client:
            yield Workers(None, client)
        return
    count = int(kind[2] or processors())
    if kind[1] == "threads":
        with concurrent.futures.ThreadPoolExecutor(count) as pool:
            yield Workers(pool.submit)
        return
    distributed = _distributed()
    with (
        distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield Workers(None, client)


@contextmanager
def local_processes(count: int) -> Iterator[Workers]:
    """Return a context with so many processes of this computer, which need no Dask.

    The end of a process is the end of its task, which runs once more, and of no other. They end with the context, at
    once, or with this process, however it ends.
    """
    spawn = multiprocessing.get_context("spawn")  # a fork of a program with threads may hang
    ending, alive = spawn.Pipe(duplex=False)
    idle = queue.LifoQueue[concurrent.futures.ProcessPoolExecutor]()
    pools = list[concurrent.futures.ProcessPoolExecutor]()

    def start() -> concurrent.futures.ProcessPoolExecutor:
        pools.append(concurrent.futures.ProcessPoolExecutor(1, spawn, _end_with, (ending,)))
        return pools[-1]

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        pool = idle.get()
        try:
            for _ in range(ATTEMPTS):
                try:
                    return pool.submit(function, *arguments).result()
                except BrokenProcessPool as error:
                    broken, pool = error, start()
                    if alive.closed:
                        break
            raise broken
        finally:
            idle.put(pool)

    for _ in range(count):
        idle.put(start())
    threads = concurrent.futures.ThreadPoolExecutor(count)
    try:
        yield Workers(lambda *task: threads.submit(call, *task))
    finally:
        alive.close()
        threads.shutdown(cancel_futures=True)
        for pool in pools:
            pool.shutdown()
        ending.close()


def _end_with(end: Connection) -> None:
    """Let this process end when the other end of a connection is closed; Ctrl-C is for the process that has it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait() -> None:
        try:
            end.poll(None)
        finally:
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def processors() -> int:
    """Return how many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _active_client() -> Any:
    """Return the Dask client that is active in this program, None where there is none."""
    if "distributed" not in sys.modules:
        return None
    try:
        return sys.modules["distributed"].Client.current()
    except ValueError:
        return None


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise SchedulerError(
            "Dask is not installed; expected the extra of it: pip install 'rodgen[dask]'"
        ) from None
    return distributed


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=ANSWERS_WITHIN)
    except (OSError, ValueError, TimeoutError) as error:
        reason = "no scheduler answers" if isinstance(error, OSError) else str(error).partition("\n")[0]
        raise SchedulerError(f"{address}: {reason}; expected {EXPECTED}") from None
    with client:
        if not client.nthreads():
            raise SchedulerError(
                f"{address}: the scheduler has no workers; expected one at least (dask worker {address})"
            )
        yield client
