"""The groups of the study, and the simulated machine with hidden effects for each number.

A group tests one claim, such as "nothing is claimed on innocent data with a drift of one sigma". Draw n of a group is
always the same machine with the same data.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from hidden_effects import BENCHES, OUTSIDE, PHYSICS, Hidden, Title, UnhiddenError, hidden, plantable
from real_machines import KINDS, real

NAMES = tuple(BENCHES)
ENOUGH = {"mount": 2.5, "ballbar": 3.0, "trunnion": 1.5, "gantry": 1.2, "gantry_rotary": 1.2}
"""Factors on the number of poses where an effect is 5 % of the RMS: with fewer, no test at 1 % over all candidates
can detect it."""


@dataclass(frozen=True)
class Group:
    """A claim, and the function that draws machines to test it."""

    name: str
    draw: Callable[[np.random.Generator, int], Hidden]
    peers: bool = False  # whether the other methods are run as well


SEVERAL = ("rotary_table", "trunnion", "gantry", "gantry_rotary", "robot")
"""Machines with several targets in a pose: only there can the readings of a pose share an error."""


def _bench(random: np.random.Generator, among: tuple[str, ...] = NAMES) -> str:
    return str(random.choice(among))


def _innocent(among: tuple[str, ...] = NAMES, **more: object) -> Callable[[np.random.Generator, int], Hidden]:
    def draw(random: np.random.Generator, seed: int) -> Hidden:
        return hidden(_bench(random, among), seed, columns="some", **more)  # type: ignore[arg-type]

    return draw


@lru_cache(maxsize=64)
def _can_hide(bench: str, least: float = 0.1) -> tuple[Title, ...]:
    """Return the effects that can be hidden on a bench, for one random plan; other plans differ little."""
    random = np.random.default_rng(0)
    return tuple(plantable(BENCHES[bench](random), random, least=least))


def _single(raises: float, **more: object) -> Callable[[np.random.Generator, int], Hidden]:
    def draw(random: np.random.Generator, seed: int) -> Hidden:
        while True:
            bench = _bench(random)
            titles = _can_hide(bench)
            # names first, so that a robot's forty readings do not crowd out the rest
            name = random.choice(sorted({name for name, _ in titles}))
            title = titles[random.choice([i for i, t in enumerate(titles) if t[0] == name])]
            size = ENOUGH.get(bench, 1.0) if raises < 1.1 else 1.0
            try:
                return hidden(bench, seed, [title], raises=raises, columns="some", size=size, **more)  # type: ignore[arg-type]
            except UnhiddenError:
                continue

    return draw


def _two(random: np.random.Generator, seed: int) -> Hidden:
    while True:
        bench = _bench(random)
        titles = _can_hide(bench, 0.3)
        first, second = random.choice(len(titles), 2, replace=False)
        try:
            return hidden(
                bench,
                seed,
                [titles[first], titles[second]],
                raises=float(random.uniform(1.2, 2.0)),
                columns="some",
            )
        except UnhiddenError:
            continue


def _approximate(random: np.random.Generator, seed: int) -> Hidden:
    places = {
        "eccentric_scale": [("rotary_table", "C"), ("trunnion", "C"), ("mount", "AZ"), ("robot", "J2")],
        "play": [("trunnion", "A"), ("gantry", "Y"), ("mount", "EL"), ("robot", "J3"), ("rotary_table", "C")],
        "thermal_lag": [("trunnion", "C"), ("gantry", "X"), ("rotary_table", "C")],
        "beam": [("gantry", "Z"), ("gantry", "X"), ("gantry_rotary", "X")],
        "bridge": [("gantry", "Y"), ("gantry", "X")],
        "carriage": [("gantry", "Y"), ("gantry", "X")],
    }
    while True:
        what = random.choice(list(PHYSICS))
        bench, place = places[what][random.integers(len(places[what]))]
        try:
            return hidden(
                bench, seed, [(what, place)], raises=float(random.uniform(1.2, 3.0)), columns="some"
            )
        except UnhiddenError:
            continue


def _outside(raises: float) -> Callable[[np.random.Generator, int], Hidden]:
    def draw(random: np.random.Generator, seed: int) -> Hidden:
        kinds = list(OUTSIDE)
        kind = kinds[(seed + random.integers(1)) % len(kinds)]
        return hidden(OUTSIDE[kind].bench, seed, outside=kind, raises=raises, columns="some", size=1.5)

    return draw


def _real(kind: str) -> Callable[[np.random.Generator, int], Hidden]:
    return lambda _, seed: real(kind, seed)


GROUPS: tuple[Group, ...] = (
    Group("innocent: white noise", _innocent(), peers=True),
    Group("innocent: pose-shared errors", _innocent(SEVERAL, wanders="pose"), peers=True),
    Group("innocent: joints that stop anywhere", _innocent(SEVERAL, wanders="joint"), peers=True),
    Group("innocent: random walk", _innocent(wanders="walk"), peers=True),
    Group("innocent: wandering (OU)", _innocent(wanders="ou"), peers=True),
    Group("innocent: day cycle", _innocent(wanders="day"), peers=True),
    Group("innocent: unequal variance, stated", _innocent(spread="stated")),
    Group("innocent: unequal variance, unknown", _innocent(spread="hidden"), peers=True),
    Group("innocent: idle covariates", _innocent(covariates=True)),
    Group("innocent: 2 % outliers", _innocent(outliers=0.02), peers=True),
    Group("innocent: 10 % outliers", _innocent(outliers=0.1), peers=True),
    Group("one effect: RMS x 1.05", _single(1.05), peers=True),
    Group("one effect: RMS x 1.2", _single(1.2), peers=True),
    Group("one effect: RMS x 2", _single(2.0), peers=True),
    Group("one effect: RMS x 10", _single(10.0), peers=True),
    Group("one effect, wandering: RMS x 1.5", _single(1.5, wanders="ou"), peers=True),
    Group("one effect, 5 % outliers: RMS x 1.5", _single(1.5, outliers=0.05), peers=True),
    Group("one effect, physics itself", _approximate, peers=True),
    Group("two effects", _two, peers=True),
    Group("outside: RMS x 1.2", _outside(1.2), peers=True),
    Group("outside: RMS x 2", _outside(2.0), peers=True),
    *(Group(f"real {kind}", _real(kind)) for kind in KINDS),
)


def drawn(group: Group, number: int) -> Hidden:
    """Return draw `number` of a group."""
    return group.draw(np.random.default_rng([zlib.crc32(group.name.encode()), number]), number)


def named(case: str) -> tuple[Group, int]:
    """Return the group and the number of a case, such as ``real 6R 17``."""
    name, _, number = case.rpartition(" ")
    return next(group for group in GROUPS if group.name == name), int(number)


def all_of(count: int, only: str = "") -> Iterator[tuple[Group, int]]:
    """Yield groups and numbers, round by round, so that a study that is stopped early has draws of each group."""
    for number in range(count):
        for group in GROUPS:
            if only in group.name:
                yield group, number
