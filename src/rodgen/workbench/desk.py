"""What all windows of a page share: the session, what follows from its state, and what runs in the background."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from threading import Event
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rodgen.calibration.problem import one_thread_in_blas
from rodgen.errors import RodgenError
from rodgen.machines.machine import Effect
from rodgen.stages import listening

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Diagnosis
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.calibration.suspects import Suspects
    from rodgen.workbench.actions import Action
    from rodgen.workbench.session import Session, State

__all__ = ["LIMITS", "Desk", "Window", "Wish", "Work"]

T = TypeVar("T")


LIMITS = "limits.toml"
"""What commands call the file of constraints."""


class Window(Protocol):
    """A window that shows a desk, :class:`rodgen.workbench.page.Page`."""

    desk: Desk
    plots: dict[str, Any]

    @property
    def state(self) -> State:
        """What holds now."""

    def show(self, name: str, place: Any, figure: Any, *, kind: str = "", revision: str = "") -> Any:
        """Draw a figure at its place."""

    async def refresh(self, what: str) -> None:
        """Show anew: ``"state"``, ``"suspects"``, ``"work"``, ``"plan"``."""


@dataclass(frozen=True)
class Wish:
    """What a plan is to be for."""

    n: int
    wanted: tuple[str, ...] = ()
    """Keys of parameters, or of effects, that are to be sharpened."""
    alternatives: tuple[Effect, ...] = ()
    """Effects that are to be told apart."""
    constraints: str = ""
    """Text of a file of constraints; empty: none."""

    def plan(self, state: State, subject: Fit | Diagnosis) -> Plan:
        """Return the plan, of a fit or a diagnosis of a state."""
        from rodgen.calibration.plan import plan, plan_for
        from rodgen.calibration.plan.constraints import constraints_of

        limits = constraints_of(self.constraints, LIMITS, state.machine) if self.constraints else None
        if self.alternatives:
            return plan_for(state.fit, [self.alternatives], self.n, constraints=limits)
        return plan(subject, self.n, wanted=self.wanted or None, constraints=limits)


class _StoppedError(Exception):
    """A user stopped it."""


@dataclass
class Work:
    """Something that takes long and may be stopped; it listens to the stages of what it calls.

    Attributes
    ----------
    what : str
    began : float
    stages : list
        What each is called, its steps that are done, and how many there are.
    """

    what: str
    began: float = field(default_factory=time.monotonic)
    stages: list[list[Any]] = field(default_factory=list)
    _stop: Event = field(default_factory=Event)

    def begin(self, what: str, total: int | None) -> None:
        """Begin a stage."""
        self._check()
        self.stages.append([what, 0, total])

    def step(self, done: int) -> None:
        """Note how many steps of a stage are done."""
        self._check()
        if self.stages:
            self.stages[-1][1] = done

    def end(self) -> None:
        """End a stage."""
        self.stages.pop()

    def stop(self) -> None:
        """End it at its next stage or step."""
        self._stop.set()

    def _check(self) -> None:
        if self._stop.is_set():
            raise _StoppedError

    @property
    def text(self) -> str:
        """What it does now: the stages, the outer ones first, with the steps of the innermost."""
        names = (f"{what} {done + 1} of {total}" if total else what for what, done, total in [*self.stages])
        doing = "stopping" if self._stop.is_set() else ": ".join(names)
        return ", ".join(filter(None, [doing, f"{time.monotonic() - self.began:.0f} s"]))

    def __call__(self, function: Callable[[], T]) -> T | None:
        """Return what a function returns; None where it was stopped."""
        with suppress(_StoppedError), listening(self):
            return function()
        return None


class Desk:
    """A session, with what its windows show.

    Attributes
    ----------
    session : Session
    windows : list of Window
    suspects : Suspects or None
        Of the present state, once they are known.
    work : Work or None
        What runs in the background.
    diagnosis : Diagnosis or None
        The last one, and the state that it is of.
    plan : Plan or None
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.windows: list[Window] = []
        self.work: Work | None = None
        self.diagnosis: tuple[State, Diagnosis] | None = None
        self.plan: tuple[State, Plan, Wish] | None = None
        self._turn, self._looking = asyncio.Lock(), asyncio.Lock()
        # Fits, tests and diagnoses each tell the BLAS library to use one thread for their time. Here they run in
        # threads of their own, and OpenBLAS may hang where the number changes while it computes in another.
        self._one_thread = one_thread_in_blas()

    async def do(self, *actions: Action) -> None:
        """Do something, or several things one after the other, and show in all windows what has come of it.

        Raises
        ------
        RodgenError
            When it cannot be done; those before it are.
        """
        await self._then(lambda: [self.session.do(action) for action in actions])

    async def go(self, at: int) -> None:
        """Undo or redo actions until the state of a number holds."""
        await self._then(lambda: self.session.go(at))

    async def undo(self) -> None:
        """Take the last action back."""
        await self._then(self.session.undo)

    async def redo(self) -> None:
        """Do again what was undone last."""
        await self._then(self.session.redo)

    async def _then(self, change: Callable[[], object]) -> None:
        async with self._turn:
            before = self.session.state
            try:
                await asyncio.to_thread(change)
            finally:
                if self.session.state is not before:
                    await self.show("state")
        await self.look()

    async def show(self, what: str) -> None:
        """Show something anew in all windows."""
        for window in [*self.windows]:
            await window.refresh(what)

    async def look(self) -> None:
        """Find what tests of the present state say, and its suspects, and show what was not known before."""
        state = self.session.state
        if "rung" not in state.__dict__:
            await asyncio.to_thread(lambda: (state.rung, self.session.ladder.noise))
            await self.show("ladder")
        async with self._looking:  # of one state at a time; the last is not waited for in vain
            if "suspects" in state.__dict__ or state is not self.session.state:
                return
            await asyncio.to_thread(lambda: state.suspects)
        if state is self.session.state:
            await self.show("suspects")

    async def check(self) -> None:
        """Find whether the files can be right, and show it."""
        state = self.session.state
        await asyncio.to_thread(lambda: state.check)
        await self.show("work")

    @property
    def suspects(self) -> Suspects | None:
        """The suspects of the present state, once they are known."""
        return self.session.state.__dict__.get("suspects")

    # in the background -------------------------------------------------------------------------------------------

    @contextmanager
    def _working(self, what: str) -> Iterator[Work]:
        if self.work is not None:
            raise RodgenError(f"{self.work.what} is still running; expected its end, or stop it")
        self.work = Work(what)
        try:
            yield self.work
        finally:
            self.work = None

    async def diagnose(self) -> None:
        """Diagnose the present state in the background; its steps are suggestions."""
        from rodgen.calibration.diagnose import diagnose

        state = self.session.state
        with self._working("Diagnosis") as work:
            await self.show("work")
            diagnosis = await asyncio.to_thread(work, lambda: diagnose(state.machine, state.data))
        if diagnosis is not None:
            self.diagnosis = state, diagnosis
        await self.show("work")

    async def make_plan(self, wish: Wish) -> None:
        """Plan what to measure next: what is wished, of the last diagnosis of the present state, else of its fit."""
        state = self.session.state
        subject: Fit | Diagnosis = state.fit
        if self.diagnosis is not None and self.diagnosis[0] is state:
            subject = self.diagnosis[1]
        with self._working("Plan") as work:
            await self.show("work")
            planned = await asyncio.to_thread(work, lambda: wish.plan(state, subject))
        if planned is not None:
            self.plan = state, planned, wish
        await self.show("work")
        await self.show("plan")

    async def discard_plan(self) -> None:
        """Show the plan no more."""
        self.plan = None
        await self.show("plan")
