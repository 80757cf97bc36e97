"""Diagnoses: machines of the study, the examples, files from the field, and real data.

A record has the verdict, what was found in its order, what is indistinguishable from it, the odds of all that, every
parameter with its standard deviation, the errors, those on poses left out, and the outliers.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from draws import GROUPS, drawn, named

import rodgen
from rodgen.errors import RodgenError

ROOT = Path(__file__).parent.parent
EACH = 13
"""Machines of a group of the study; `EACH_LONG` of those that take 10 s and more."""
EACH_LONG = 10
LONG = ("two_windups", "hexapod", "real 7R", "real 6R", "real fork", "real 3-sps-s", "real tricept")
"""What takes longest, and is begun first."""
REAL = (
    ("examples/machines/mount/machine.toml", "tests/data/mmt_2025/data.csv"),
    ("tests/data/positioner/machine.toml", "tests/data/positioner/data.csv"),
)


def files() -> dict[str, tuple[Path, Path]]:
    """Return machine file and data of each case that is not of the study: each machine of a folder with each table."""
    folders = sorted(
        path.parent
        for part in ("answers/field", "examples/machines")
        for path in (ROOT / part).rglob("*.toml")
    )
    pairs = [
        (m, d)
        for folder in dict.fromkeys(folders)
        for m in sorted(folder.glob("*.toml"))
        for d in sorted(folder.glob("*.csv"))
    ]
    pairs += [(ROOT / m, ROOT / d) for m, d in REAL]
    return {f"{d.parent.relative_to(ROOT)}: {m.name}, {d.name}": (m, d) for m, d in pairs}


def cases() -> list[str]:
    """Return the names of all, the longest first."""
    numbers = {g.name: EACH_LONG if g.name.startswith(LONG) else EACH for g in GROUPS}
    names = [f"{name} {n}" for name, several in numbers.items() for n in range(several)] + list(files())
    return sorted(names, key=lambda name: next((i for i, long in enumerate(LONG) if long in name), len(LONG)))


def answers(case: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the key and the record of one diagnosis."""
    with TemporaryDirectory() as folder:
        if case in files():
            machine, data = (Path(shutil.copy(path, folder)) for path in files()[case])
        else:
            machine, data = drawn(*named(case)).write(Path(folder))
        record = {"inputs": digest(machine.read_text(encoding="utf-8"), data.read_text(encoding="utf-8"))}
        try:
            record |= record_of(rodgen.Machine.load(machine).fit(rodgen.Measurements.load(data)).diagnose())
        except RodgenError as error:
            record["message"] = str(error).replace(f"{folder}/", "")
    yield case, record


def digest(*texts: str) -> str:
    """Return a digest of texts whose numbers are rounded to nine digits: the last ones differ between processors."""
    found = hashlib.sha256()
    for text in texts:
        found.update(
            re.sub(r"-?\d+\.\d{8,}(e[-+]?\d+)?", lambda number: f"{float(number[0]):.8e}", text).encode()
        )
    return found.hexdigest()[:16]


def name_of(effect: Any) -> str:
    """Return an effect's name and place."""
    return " at ".join(filter(None, effect.identity))


def record_of(found: Any) -> dict[str, Any]:
    """Return what a diagnosis says, as plain data."""
    rms = found.rms
    replaced = [
        *(((s.effect,), a) for s in found.steps for a in s.indistinguishable_from),
        *((one.named, one) for one in found.indistinguishable_sets),
    ]
    equals = {
        f"{' and '.join(name_of(e) for e in several)} = {' and '.join(name_of(e) for e in one.effects)}": one.odds
        for several, one in replaced
    }
    return {
        "verdict": found.verdict,
        "reason": found.reason or found.wrong_bounds,
        "steps": [
            *(name_of(step.effect) for step in found.steps),
            *(
                f"{form.component} += {form.form} at {form.joint}, by {form.driver}"
                for form in found.unexplained
            ),
        ],
        "equals": list(equals),
        "odds": [
            *(f"{name_of(one.effect)}: {rounded(one.odds)}" for one in found.found),
            *(f"{text}: {rounded(odds)}" for text, odds in equals.items()),
        ],
        "sizes": {key: [number(e.value, 9), number(e.std, 5)] for key, e in found.estimates.items()},
        "rms": [number(x, 8) for x in (rms.before, rms.after, rms.noise)],
        "held out": [number(x, 8) for x in (rms.before_held_out, rms.after_held_out)],
        "outliers": list(found.outliers),
    }


def number(x: float | None, digits: int) -> float | None:
    """Return a number with so many digits."""
    return None if x is None else float(f"{x:.{digits}g}")


def rounded(odds: float) -> str:
    """Return odds with two digits, at most a million."""
    return f"{min(odds, 1e6):.1e}"
