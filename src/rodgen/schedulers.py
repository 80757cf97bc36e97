"""Where independent tasks run: threads of this program, processes of this computer, or the workers of a Dask scheduler.

Tasks are calls of one function with few bytes as arguments and few as results; what they work on they read themselves.
A task whose worker was killed runs again on another one. Dask is imported only where its schedulers are asked for, or
active already.
"""

from __future__ import annotations

import concurrent.futures
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from rodgen.errors import RodgenError, shown
from rodgen.stages import stage, step

Item = TypeVar("Item")
Result = TypeVar("Result")

ANSWERS_WITHIN = 10
"""Seconds within which a scheduler must answer."""
EXPECTED = "threads, processes, either with =N for N of them, or the address of a Dask scheduler: tcp://localhost:8786"


class SchedulerError(RodgenError):
    """A scheduler that cannot be used, in one sentence."""


class Workers:
    """What runs tasks.

    Parameters
    ----------
    executor : concurrent.futures.Executor, or distributed.Client
    count : int
        How many tasks run at a time.
    """

    address: str | None = None
    """By which `workers` were asked for them."""

    def __init__(self, executor: Any, count: int) -> None:
        self._executor = executor
        self.count = count

    @property
    def client(self) -> Any:
        """The Dask client, None of threads."""
        return None if self.are_threads else self._executor

    @property
    def are_threads(self) -> bool:
        """Whether tasks run in this program."""
        return isinstance(self._executor, concurrent.futures.Executor)

    def hold(self, items: Sequence[Item]) -> Sequence[Any]:
        """Return the items for `each`, which then calls functions of an item where it was called before.

        So what an item loads and keeps for itself is there. On another worker, where one was killed, it is a new copy.
        """
        return items if self.are_threads else self._executor.map(_itself, items, pure=False)

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
        with stage(what, len(items)):
            if self.are_threads:
                runs = self._in_threads(function, items, common)
            else:
                runs = self._on_workers(function, items, common, of_killed)
            for done, answer in enumerate(runs, 1):
                step(done)
                yield answer

    def _in_threads(
        self, function: Callable[..., Result], items: Sequence[Item], common: tuple[Any, ...]
    ) -> Iterator[tuple[int, Result]]:
        futures = {self._executor.submit(function, item, *common): k for k, item in enumerate(items)}
        try:
            for future in concurrent.futures.as_completed(list(futures)):
                yield futures.pop(future), future.result()
        finally:
            for future in futures:
                future.cancel()

    def _on_workers(
        self,
        function: Callable[..., Result],
        items: Sequence[Item],
        common: tuple[Any, ...],
        of_killed: Callable[[int], Result] | None,
    ) -> Iterator[tuple[int, Result]]:
        import distributed
        from distributed.scheduler import KilledWorker

        # scattered, what is common would be lost with the worker that has it: it travels with the tasks
        futures = self._executor.map(_Call(function, common), items, pure=False)
        numbers = {future.key: k for k, future in enumerate(futures)}
        waiting: Any = distributed.as_completed(futures)  # type: ignore[no-untyped-call]
        del futures  # so that each result leaves the worker as soon as it is here
        try:
            for future in waiting:
                number = numbers[future.key]
                try:
                    yield number, future.result()
                except KilledWorker as error:
                    if of_killed is None:
                        raise SchedulerError(
                            f"workers of the scheduler were killed {error.allowed_failures + 1} times by one task; "
                            "expected workers with more memory, or smaller parts of the work"
                        ) from None
                    yield number, of_killed(number)
        finally:
            waiting.clear()


def _itself(item: Item) -> Item:
    return item


class _Call:
    """A function with its last arguments."""

    def __init__(self, function: Callable[..., Any], common: tuple[Any, ...]) -> None:
        self.function, self.common = function, common

    def __call__(self, item: Any) -> Any:
        return self.function(item, *self.common)


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
    with _made(address) as made:
        made.address = address
        before = _active.set(made)
        try:
            yield made
        finally:
            _active.reset(before)


@contextmanager
def _made(address: str | None) -> Iterator[Workers]:
    client = _active_client() if address is None else None
    if client is not None:
        yield _of(client)
        return
    kind = re.fullmatch(r"(threads|processes)(?:=([1-9]\d{0,3}))?", address or "threads")
    if kind is None and "://" not in (address or ""):
        raise SchedulerError(f"scheduler {shown(address)}; expected {EXPECTED}")
    if kind is None:
        with _connected(str(address)) as found:
            yield _of(found)
        return
    count = int(kind[2] or processors())
    if kind[1] == "threads":
        with concurrent.futures.ThreadPoolExecutor(count) as pool:
            yield Workers(pool, count)
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
        yield Workers(client, count)


def processors() -> int:
    """Return how many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _of(client: Any) -> Workers:
    return Workers(client, max(sum(client.nthreads().values()), 1))


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
