"""Score diagnoses of the second simulator's machines, by public functions and the documented JSON."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy import stats
from table import coverage, line

import rodgen
from physics.chain import Title
from physics.draws import Draw, UnfitError, error, misfit, with_effects

ALIKE = (
    4.0  # by how much the mean chi-square of readings may rise with another effect: two standard deviations
)
INEXACT = (
    0.2  # what the catalogue's formulas leave of true effects, over the noise: the error rises by 2 percent
)
Record = dict[str, Any]


def judged(draw: Draw, *, show: bool = False) -> Record:
    """Diagnose a draw and compare the answer with the truth.

    A step is right where it names a true effect; an accepted equivalent; an effect with which the readings, without
    their errors, are fitted as well as with the true one; or where it states the true one as indistinguishable.
    """
    with TemporaryDirectory() as folder:
        files = draw.write(Path(folder))
        machine = rodgen.Machine.load(files[0])
        data, further = (rodgen.Measurements.load(file) for file in files[1:])
    base = machine.fit(data)  # kernels are made here, so that they do not count as time of the diagnosis
    start = time.process_time()
    found = machine.fit(data).diagnose()
    seconds = time.process_time() - start
    if show:
        print(found)
    answer = found.to_dict()
    steps = [_title(step) for step in answer["steps"]]
    stated = [
        {_title(one["effects"][0]) for one in step["indistinguishable_from"] if not one["effects"][1:]}
        for step in answer["steps"]
    ]
    forms = [(form["driver"], form["joint"]) for form in answer["unexplained"]]
    right = _right(draw, machine, base, steps, stated)
    reached = set(right.values())
    for k, instead in _replaced(
        answer
    ):  # two true effects are stated in the place of one step, or for two steps
        if not set(k) <= set(right) and set(instead) <= set(draw.truth):
            right |= {number: instead[0] for number in k if number not in right}
            reached |= set(instead)
    inexact = {place for _, place in draw.truth} if draw.remainder > INEXACT else set()
    false = [steps[k] for k in range(len(steps)) if k not in right and steps[k][1] not in inexact]
    drivers = [set(re.findall(r"\w+", str(driver))) & draw.drivers for driver, _ in forms]
    false_forms = [forms[k] for k in range(len(forms)) if not drivers[k] and forms[k][1] not in inexact]
    record: Record = {
        "truth": [list(title) for title in draw.truth],
        "drivers": sorted(draw.drivers),
        "verdict": answer["verdict"],
        "steps": [list(title) for title in steps],
        "stated": [sorted(map(list, titles), key=str) for titles in stated],
        "forms": [list(form) for form in forms],
        "false": [*map(list, false), *map(list, false_forms)],
        "right": len(right),
        "claims": len(steps) + len(forms),
        "missed": [list(title) for title in draw.truth if title not in reached],
        "first": 0 in right,
        "first_named": bool(steps) and steps[0] in draw.truth,
        "raises": list(draw.raises),
        "remainder": draw.remainder,
        "seconds": seconds,
    }
    if draw.outside:
        record["recognised"] = answer["verdict"] == "unknown_effect" and any(drivers)
        record["place"] = any(d and place == draw.where for d, (_, place) in zip(drivers, forms, strict=True))
    loss = "huber" if draw.outliers else "linear"
    own = with_effects(machine, draw.truth).fit(data, loss=loss)
    record["further"] = error(found.machine.fit(data), further, draw)
    record["further_true"] = 1.0 if draw.outside else error(own, further, draw)
    picked = set(answer["outliers"])
    record["outliers"] = [len(picked & draw.outliers), len(draw.outliers), len(picked)]
    if set(steps) == set(draw.truth) and not forms and not inexact:
        record["coverage"] = _coverage(draw, answer, own.degrees_of_freedom)
    return record


def _title(step: Any) -> Title:
    return step["effect"], step["joint"]


def _replaced(answer: Any) -> list[tuple[list[int], list[Title]]]:
    """Return which steps, by number, may be instead which effects, as the answer states it."""
    numbers = {_title(step): k for k, step in enumerate(answer["steps"])}
    found = [
        ([k], [_title(effect) for effect in pair["effects"]])
        for k, step in enumerate(answer["steps"])
        for pair in step["indistinguishable_from"]
        if pair["effects"][1:]
    ]
    for one in answer.get("indistinguishable_sets", ()):
        named = [numbers[_title(step)] for step in one.get("steps", one.get("named", ()))]
        found.append((named, [_title(effect) for effect in one["effects"]]))
    return found


def _right(
    draw: Draw, machine: Any, base: Any, steps: Sequence[Title], stated: Sequence[set[Title]]
) -> dict[int, Title]:
    """Match steps with true effects, each at most once: the step's number with the effect that it stands for."""
    found: dict[int, Title] = {}

    def match(holds: Callable[[int, Title], bool]) -> None:
        for k in range(len(steps)):
            for title in draw.truth:
                if k not in found and title not in found.values() and holds(k, title):
                    found[k] = title

    match(lambda k, title: steps[k] == title)
    match(lambda k, title: steps[k] in draw.equal.get(title, ()))
    match(lambda k, title: title in stated[k])
    match(
        lambda k, title: _alike(draw, machine, base, tuple(steps[k] if t == title else t for t in draw.truth))
    )
    if len(found) < len(steps) <= len(draw.truth) and _alike(draw, machine, base, tuple(steps)):
        return dict(zip(range(len(steps)), draw.truth, strict=False))
    if draw.outside and len(steps) == 1 and _alike(draw, machine, base, tuple(steps)):
        found[0] = steps[0]
    return found


def _alike(draw: Draw, machine: Any, base: Any, titles: tuple[Title, ...]) -> bool:
    """Return whether effects fit the readings without errors as well as the true ones do."""
    unit = 1.0 if base.unit != "arcsec" else np.pi / 180
    try:
        left = misfit(with_effects(machine, titles), draw.noiseless, draw.sigma * unit)
    except (rodgen.RodgenError, UnfitError):
        return False
    return (left**2 - draw.remainder**2) * base.degrees_of_freedom <= ALIKE


def _coverage(draw: Draw, answer: Any, freedoms: int) -> list[int]:
    """Return how many intervals of 95 % hold the catalogue's parameter, and how many there are."""
    stated = "\nnoise = " in draw.machine
    quantile = stats.norm.ppf(0.975) if stated else stats.t.ppf(0.975, freedoms)
    held = counted = 0
    for step in answer["steps"]:
        name, place = _title(step)
        for key, estimate in step["parameters"].items():
            true = draw.values.get(f"{place}.{name}.{key}" if place else f"{name}.{key}")
            searched = key == "P" or (key, name) == ("tau", "warm_up_drift")  # not symmetric
            if true is None or searched or not estimate["std"] or estimate.get("convention"):
                continue
            counted += 1
            held += bool(abs(estimate["value"] - true) <= quantile * estimate["std"])
    return [held, counted]


def table(records: Sequence[Record]) -> str:
    """Return the figures of the study, by group and over all."""
    broken = [r for r in records if "error" in r]
    good = [r for r in records if "error" not in r]
    lines = [f"{len(records)} machines made from physics; 95 % Clopper-Pearson intervals", ""]
    if broken:
        lines += [f"{len(broken)} diagnoses ended in an error:"]
        lines += [f"  {r['group']} {r['number']}: {r['error']}" for r in broken[:10]] + [""]
    if not good:
        return "\n".join(lines)

    def share(title: str, some: Iterable[Record], hit: Callable[[Record], Any]) -> str:
        some = list(some)
        return line(title, sum(bool(hit(r)) for r in some), len(some))

    def of(start: str) -> list[Record]:
        return [r for r in good if r["group"].startswith(start)]

    for start, title, hit in (
        ("innocent", "False claims on innocent machines", lambda r: r["claims"] > 0),
        ("one effect", "The effect, or its equal, comes first", lambda r: r["first"]),
        (
            "t",
            "Two or three effects: nothing false, nothing missed",
            lambda r: not (r["false"] or r["missed"]),
        ),
        ("outside", "Outside the catalogue: recognised, with its driver", lambda r: r["recognised"]),
    ):
        some = of(start)
        if some:
            lines.append(title)
            for group in dict.fromkeys(r["group"] for r in some):
                name = group.removeprefix("innocent: ")
                lines.append(share(f"  {name}", [r for r in some if r["group"] == group], hit))
            lines += [share("  all together", some, hit), ""]
    hidden = [r for r in good if r["truth"]]
    outside = of("outside")
    lines.append("All together")
    lines.append(share("  a false claim, all machines", good, lambda r: r["false"]))
    lines.append(share("    on machines with an effect of the catalogue", hidden, lambda r: r["false"]))
    lines.append(share("    on machines with one outside it", outside, lambda r: r["false"]))
    lines.append(share("  first answer by its own name", hidden, lambda r: r["first_named"]))
    lines.append(share("  no answer (cannot_tell)", good, lambda r: r["verdict"] == "cannot_tell"))
    true = sum(len(r["truth"]) for r in hidden)
    if true:
        right, false = sum(r["right"] for r in hidden), sum(len(r["false"]) for r in hidden)
        precision = right / max(right + false, 1)
        recall = 1 - sum(len(r["missed"]) for r in hidden) / true
        both = 2 * precision * recall / max(precision + recall, 1e-9)
        lines.append(
            f"  precision {precision:.3f}, recall {recall:.3f}, F1 {both:.3f}, of {true} effects; {false} false claims"
        )
    wanders = [r for r in good if "wandering" in r["group"]]
    some = [r["coverage"] for r in good if "coverage" in r and r not in wanders]
    if sum(n for _, n in some):
        lines.append(coverage("  95 % intervals that hold the true parameter", some, (0.94, 0.96)))
    lines.append(
        share(
            "  error on further data within 5 % of the true model's",
            good, lambda r: r["further"] <= 1.05 * max(r["further_true"], 1.0),
        )
    )  # fmt: skip
    ratios = np.array([r["further"] / r["further_true"] for r in good])
    middle, most = np.quantile(ratios, [0.5, 0.95])
    lines.append(f"  that error over the true model's: median {middle:.3f}, 95 % below {most:.3f}")
    picked, wrong, all_picked = np.sum([r["outliers"] for r in good], 0)
    lines.append(
        f"  gross errors: {picked} of {wrong} are found, {all_picked - picked} other rows are left out"
    )
    times = np.array([r["seconds"] for r in good])
    lines.append(
        f"  processor time of a diagnosis: median {np.median(times):.2f} s, at most {times.max():.1f} s; "
        f"{times.sum():.0f} s in all, {sum(r['processor_seconds'] for r in good):.0f} s with draws and judgement"
    )
    return "\n".join(lines)
