"""Compare the frozen answers with those of today, and say of what kind each difference is.

An answer is a record: a mapping from fields to plain data, and to arrays of kernels. The name of a field says how it is
compared: a verdict by equality, a size in its standard deviations, a text word by word and number by number, an array
in units of its last place. What arithmetic of another processor may do is the kind "rounding", which does not count:

- of a fit, `OF_SD` of a standard deviation and `RELATIVE` of an error: a fit ends where a further step lowers its
  cost by less than rounding does, so that its parameters are determined to about the root of that;
- of a number in a text, `RELATIVE`, or one unit of the last digit that stands there;
- of an array, what its part says: see `kernels.allowance` and `machines.allowance`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

OF_SD = 1e-4
RELATIVE = 1e-6
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
ROUNDING = "rounding"

Record = Mapping[str, Any]
Allowance = Callable[[str, str, np.ndarray], np.ndarray]
"""How far each number of an array may be off: by the key of the record, the name of the array, and its values."""


@dataclass(frozen=True)
class Difference:
    """One difference: its kind, the answer that has it, and what was and is."""

    kind: str
    key: str
    text: str

    @property
    def counts(self) -> bool:
        """Whether it is more than rounding."""
        return not self.kind.startswith(ROUNDING)


def differences(
    frozen: Mapping[str, Record], today: Mapping[str, Record], allowance: Allowance | None = None
) -> Iterator[Difference]:
    """Yield what differs between the answers of one part."""
    for key in sorted(frozen.keys() | today.keys()):
        if key not in today:
            yield Difference("entry missing", key, "frozen, but not answered today")
        elif key not in frozen:
            yield Difference("entry new", key, "answered today, but not frozen")
        elif frozen[key].get("inputs") != today[key].get("inputs"):
            yield Difference("inputs changed", key, "another question, so that answers are not compared")
        else:
            yield from _of_record(key, frozen[key], today[key], allowance)


def _of_record(key: str, old: Record, new: Record, allowance: Allowance | None) -> Iterator[Difference]:
    for field in sorted(old.keys() | new.keys()):
        before, after = old.get(field), new.get(field)
        if field == "arrays":
            for name in sorted((before or {}).keys() | (after or {}).keys()):
                yield from _of_array(key, name, (before or {}).get(name), (after or {}).get(name), allowance)
        elif before == after:
            continue
        elif field == "sizes":
            yield from _of_sizes(key, before or {}, after or {})
        elif field in ERRORS:
            kind = ERRORS[field]
            off = _relative(before, after)
            yield Difference(
                f"{ROUNDING}: {kind}" if off <= RELATIVE else f"{kind} moved",
                key,
                f"{before} -> {after}, by {off:.2g} of it",
            )
        elif field == "files":
            for name in sorted((before or {}).keys() | (after or {}).keys()):
                pair = (before or {}).get(name), (after or {}).get(name)
                if None in pair:
                    yield Difference("file missing" if pair[1] is None else "file new", key, name)
                elif pair[0] != pair[1]:
                    yield _of_text("file", key, *pair, name)
        elif field in WORDS:
            yield Difference(f"{field} changed", key, f"{_short(before)} -> {_short(after)}")
        else:
            yield _of_text(field, key, before, after)


WORDS = ("verdict", "steps", "equals", "outliers", "exit code")
ERRORS = {"rms": "error", "held out": "held-out error"}


def _relative(before: Any, after: Any) -> float:
    """Return the largest relative change of numbers; infinite where there is none any more."""
    if before is None or after is None or len(before) != len(after):
        return np.inf
    if any((a is None) != (b is None) for a, b in zip(before, after, strict=True)):
        return np.inf
    pairs = [(a, b) for a, b in zip(before, after, strict=True) if a is not None]
    return max((abs(b - a) / max(abs(a), abs(b)) for a, b in pairs if a != b), default=0.0)


def _of_sizes(key: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Difference]:
    """Yield the sizes that moved, each by how many of its standard deviations."""
    for name in sorted(before.keys() | after.keys()):
        if (name in before) != (name in after):
            yield Difference("size missing" if name in before else "size new", key, name)
            continue
        (x, sd), (y, new_sd) = before[name], after[name]
        if (x, sd) == (y, new_sd):
            continue
        text = f"{name}: {x} ± {sd} -> {y} ± {new_sd}"
        if (sd is None) != (new_sd is None):
            yield Difference("size undetermined" if new_sd is None else "size determined", key, text)
            continue
        off = abs(y - x) / sd if sd else _relative([x], [y]) * OF_SD / RELATIVE
        off = max(off, abs(new_sd / sd - 1) if sd else 0.0)
        kind = "rounding: size" if off <= OF_SD else "size moved"
        yield Difference(kind, key, f"{text}, by {off:.2g} sd")


def _of_text(field: str, key: str, before: Any, after: Any, name: str = "") -> Difference:
    """Return how two texts, or lists of lines, differ: by rounding where only last digits of numbers do."""
    old, new = (x if isinstance(x, list) else [str(x)] for x in (before, after))
    where = f"{name}: " if name else ""
    for n, (a, b) in enumerate(zip(old, new, strict=False), 1):
        if a != b and not _same_but_for_digits(a, b):
            return Difference(f"{field} changed", key, f"{where}line {n}: {_short(a)} -> {_short(b)}")
    if len(old) != len(new):
        return Difference(f"{field} changed", key, f"{where}{len(old)} lines -> {len(new)} lines")
    n, a, b = next((n, a, b) for n, (a, b) in enumerate(zip(old, new, strict=True), 1) if a != b)
    return Difference(f"{ROUNDING}: {field}", key, f"{where}line {n}: {_short(a)} -> {_short(b)}")


def _same_but_for_digits(a: str, b: str) -> bool:
    if re.sub(r"[-+\s]+", " ", NUMBER.sub("#", a)) != re.sub(r"[-+\s]+", " ", NUMBER.sub("#", b)):
        return False
    pairs = zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)
    return all(x == y or abs(float(x) - float(y)) <= _room(x, y) for x, y in pairs)


def _room(x: str, y: str) -> float:
    """Return by how much two numbers of a text may differ: whole numbers by nothing."""
    if not re.search("[.eE]", x + y):
        return 0.0
    mantissa, _, power = max(x, y, key=len).lower().partition("e")
    unit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return max(1.01 * unit, RELATIVE * max(abs(float(x)), abs(float(y))))


def _of_array(
    key: str, name: str, old: np.ndarray | None, new: np.ndarray | None, allowance: Allowance | None
) -> Iterator[Difference]:
    if old is None or new is None:
        yield Difference("array missing" if new is None else "array new", key, name)
        return
    if old.shape != new.shape or old.dtype != new.dtype:
        yield Difference("shape changed", key, f"{name}: {old.dtype}{old.shape} -> {new.dtype}{new.shape}")
        return
    different = (old != new) & ~((old != old) & (new != new))  # NaN stays NaN
    if not different.any():
        return
    whole = not np.issubdtype(old.dtype, np.floating)
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(new.astype(float) - old)
        room = np.zeros(old.shape) if whole or allowance is None else allowance(key, name, old)
        beyond = different & ~((off <= room) | np.isnan(room))
        units = off / np.spacing(np.abs(np.where(np.isfinite(old), old, 1.0)))
        relative = off / np.nanmax(np.abs(np.where(np.isfinite(old), old, np.nan)), initial=np.spacing(1.0))
    at = beyond if beyond.any() else different
    worst = np.unravel_index(np.argmax(np.where(at, np.nan_to_num(relative, nan=np.inf), -1)), old.shape)
    kind = f"{'code' if whole else 'value'} moved" if beyond.any() else f"{ROUNDING}: value"
    values = f"{old[worst]!s} -> {new[worst]!s}"
    size = "" if whole else f", {units[worst]:.3g} ulp, {relative[worst]:.2g} of the largest"
    place = ", ".join(map(str, worst))
    yield Difference(kind, key, f"{name}: {at.sum()} of {old.size} numbers; at ({place}): {values}{size}")


def _short(x: Any, most: int = 160) -> str:
    text = repr(x)
    return text if len(text) <= most else f"{text[:most]} ..."


def report(found: list[Difference], *, every: bool, examples: int = 3) -> str:
    """Return differences by kind: how many, and the first of each, or all of them."""
    by_kind: dict[str, list[Difference]] = {}
    for one in found:
        by_kind.setdefault(one.kind, []).append(one)
    lines = []
    for kind in sorted(by_kind, key=lambda kind: (kind.startswith(ROUNDING), -len(by_kind[kind]), kind)):
        several = by_kind[kind]
        lines.append(f"{kind}: {len(several)}")
        shown = several if every else several[:examples]
        lines += [f"    {one.key}: {one.text}" for one in shown]
        if len(shown) < len(several):
            lines.append(f"    ... and {len(several) - len(shown)} more (ALL=1 lists them)")
    return "\n".join(lines)
