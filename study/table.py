"""Write the table of the study: shares with binomial intervals, compared with the required bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from scipy import stats

Record = dict[str, Any]


def interval(hits: float, trials: float, level: float = 0.95) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a proportion.

    >>> [round(x, 3) for x in interval(0, 100)]
    [0.0, 0.036]
    """
    rest = (1 - level) / 2
    low = 0.0 if hits == 0 else float(stats.beta.ppf(rest, hits, trials - hits + 1))
    high = 1.0 if hits == trials else float(stats.beta.ppf(1 - rest, hits + 1, trials - hits))
    return low, high


def design_effect(pairs: Sequence[Sequence[int]]) -> float:
    """Return how many trials count as one where those of a group (hits, trials) fail together; 1 at least.

    >>> design_effect([(6, 6), (6, 6), (0, 6), (6, 6)])
    6.0
    """
    hits, trials = np.array(pairs, float).reshape(-1, 2).T
    share = hits.sum() / max(trials.sum(), 1)
    alone = share * (1 - share) * trials.sum()
    return max(1.0, float(((hits - share * trials) ** 2).sum() / alone)) if alone > 0 else 1.0


def verdict(hits: float, trials: float, bar: tuple[float, float]) -> str:
    """Return whether a share is within its required bounds: with confidence, by the estimate alone, or not.

    >>> verdict(0, 1000, (0, 0.02)), verdict(1, 60, (0, 0.02)), verdict(9, 60, (0, 0.02))
    ('kept', 'kept so far', 'NOT KEPT')
    """
    low, high = interval(hits, trials)
    inside = bar[0] <= hits / trials <= bar[1]
    if not inside:
        return "NOT KEPT" if high < bar[0] or low > bar[1] else "missed so far"
    return "kept" if bar[0] <= low and high <= bar[1] else "kept so far"


def line(
    title: str, hits: int, trials: int, bar: tuple[float, float] | None = None, alike: float = 1.0
) -> str:
    """Return a line with a share, its interval, its required bounds and whether it keeps them.

    So many trials as `alike` says count as one.
    """
    if not trials:
        return f"{title:<58} no draws"
    low, high = interval(hits / alike, trials / alike)
    text = f"{title:<58} {hits:5d}/{trials:<5d} {hits / trials:7.1%}  [{low:6.1%}, {high:6.1%}]"
    if bar is None:
        return text
    wanted = (
        f">= {bar[0]:.0%}"
        if bar[1] == 1
        else f"<= {bar[1]:.0%}"
        if bar[0] == 0
        else f"{bar[0]:.0%}-{bar[1]:.0%}"
    )
    return f"{text}  {wanted:>8}  {verdict(hits / alike, trials / alike, bar)}"


def coverage(title: str, pairs: Sequence[Sequence[int]], bar: tuple[float, float]) -> str:
    """Return a line on intervals of confidence, of which those of one machine (held, all) hold or fail together."""
    held, counted = (sum(pair[i] for pair in pairs) for i in (0, 1))
    return line(title, held, counted, bar, design_effect(pairs))


def table(records: Sequence[Record], seconds: float) -> str:
    """Return the table of the whole study."""
    broken = [r for r in records if "error" in r]
    met = [r for r in records if "error" not in r and r["group"].startswith("real")]
    good = [r for r in records if "error" not in r and not r["group"].startswith("real")]

    def of(start: str) -> list[Record]:
        return [r for r in good if r["group"].startswith(start)]

    def share(title: str, some: Iterable[Record], hit: Callable[[Record], bool], bar: Any = None) -> str:
        some = list(some)
        return line(title, sum(map(hit, some)), len(some), bar)

    groups = list(dict.fromkeys(r["group"] for r in good))
    lines = [
        f"{len(records)} machines in {seconds:.0f} s; 95 % Clopper-Pearson intervals; bounds at family-wise 1 %",
        "",
    ]
    if broken:
        lines += [f"{len(broken)} diagnoses ended in an error:"]
        lines += [f"  {r['group']} {r['number']}: {r['error']}" for r in broken[:10]] + [""]

    lines += as_met(met)
    if not good:
        return "\n".join(lines)

    lines.append("False claims on innocent data")
    for group in groups:
        if group.startswith("innocent"):
            lines.append(share(f"  {group[10:]}", of(group), lambda r: r["false"], (0, 0.02)))
    lines.append(share("  all together", of("innocent"), lambda r: r["false"], (0, 0.02)))
    lines.append(share("  no answer (cannot_tell)", of("innocent"), lambda r: r["cannot_tell"]))

    lines += ["", "The effect, or one that the data cannot distinguish from it, comes first"]
    ones = of("one effect")
    for group in groups:
        if group.startswith("one effect"):
            bar = (0.95, 1) if "physics" not in group else None
            lines.append(share(f"  {group}", of(group), lambda r: r["first"], bar))
    plain = [r for r in ones if "physics" not in r["group"]]
    lines.append(share("  all of the catalogue's", plain, lambda r: r["first"], (0.95, 1)))
    lines.append(share("    of these by its own name", plain, lambda r: r["first_named"]))
    lines.append(share("    of these with no further effect", plain, lambda r: r["exact"]))
    lines.append(
        share("  physics itself: no further effects", of("one effect, physics"), lambda r: r["further"] <= 0)
    )

    lines += ["", "Two effects"]
    lines.append(
        share("  exactly these two, or indistinguishable ones", of("two"), lambda r: r["exact"], (0.9, 1))
    )
    lines.append(share("  exactly these two by name", of("two"), lambda r: r["named"]))

    lines += ["", "Accuracy reached"]
    known = plain + of("two")
    lines.append(
        share(
            "  error after adding within 5 % of the true model's",
            known,
            lambda r: abs(r["reached"] - 1) <= 0.05,
            (0.95, 1),
        )
    )
    held, counted = (sum(r["coverage"][i] for r in known if "coverage" in r) for i in (0, 1))
    lines.append(line("  95 % intervals that contain the true parameter", held, counted, (0.9, 0.99)))
    lengths = [n for r in known for n in r["aliases"]]
    if lengths:
        lines.append(
            f"  effects indistinguishable from one found: {np.mean(lengths):.2f} on average, {max(lengths)} at most"
        )

    lines += ["", "Outside the catalogue"]
    for group in groups:
        if group.startswith("outside"):
            lines.append(
                share(f"  {group[9:]}: recognised as such", of(group), lambda r: r["recognised"], (0.95, 1))
            )
            lines.append(share(f"  {group[9:]}: driver right", of(group), lambda r: r["driver"], (0.95, 1)))
            lines.append(
                share(
                    f"  {group[9:]}: error within 10 % of what can be reached",
                    of(group),
                    lambda r: r["reached"] < 1.1,
                    (0.95, 1),
                )
            )
            lines.append(
                share(
                    f"  {group[9:]}: no effect of the catalogue",
                    of(group),
                    lambda r: not r["spurious"],
                    (0.8, 1),
                )
            )

    lines += ["", _times(good)]
    lines += _side_by_side([r for r in good if "peers" in r])
    return "\n".join(lines)


def as_met(records: Sequence[Record]) -> list[str]:
    """Return the lines on machines as they are met, one column of right answers a kind and the bars over all."""
    if not records:
        return []
    lines = ["Machines as they are met"]

    def right(r: Record) -> bool:
        return not r["false"] and not r["missed"]

    for group in dict.fromkeys(r["group"] for r in records):
        some = [r for r in records if r["group"] == group]
        lines.append(line(f"  {group}: nothing false, nothing missed", sum(map(right, some)), len(some)))
    claims = [name for r in records for name in r["plausible"]]
    lines.append(line("  no answer (cannot_tell)", sum(r["cannot_tell"] for r in records), len(records)))
    lines.append(line("  a false claim", sum(r["false"] for r in records), len(records), (0, 0.01)))
    innocent = [r for r in records if not r["truth"]]
    lines.append(
        line("    of these on machines with nothing", sum(r["false"] for r in innocent), len(innocent))
    )
    shown = [r for r in records if r["seen"]]
    lines.append(
        line(
            "  all effects that show are named, or an equivalent",
            sum(not r["missed"] for r in shown),
            len(shown),
            (0.95, 1),
        )
    )
    effects, missed = sum(len(r["seen"]) for r in records), sum(len(r["missed"]) for r in records)
    lines.append(line("    of single effects that show", effects - missed, effects))
    lines.append(line("  a step that is right has a plausible name", sum(claims), len(claims), (0.9, 1)))
    claims = [name for r in records for name in r["named"]]
    lines.append(line("    the true one", sum(claims), len(claims)))
    title = "  error on further readings within 5 % of the true model's"
    lines.append(line(title, sum(r["further"] <= 1.05 for r in records), len(records), (0.95, 1)))
    title = "    the same of a model with the effects that a test at 1 % finds"
    lines.append(line(title, sum(r["further_shown"] <= 1.05 for r in records), len(records)))
    title = "    within 5 % of the worse of that and the true model"
    lines.append(
        line(title, sum(r["further"] <= 1.05 * max(r["further_shown"], 1) for r in records), len(records))
    )
    for at_rest, where in ((True, "set-up at rest"), (False, "wandering set-up")):
        for what in ("effects", "geometry"):
            some = [r["coverage"][what] for r in records if "coverage" in r and at_rest != bool(r["wanders"])]
            lines.append(coverage(f"  95 % intervals of {what}, {where}", some, (0.94, 0.96)))
    for what in ("effects", "geometry"):
        some = [r["coverage_true"][what] for r in records if "coverage_true" in r]
        title = f"    those of {what} in fits with the true effects, all at rest"
        lines.append(coverage(title, some, (0.94, 0.96)))
    lines.append(
        line(
            "  a size that no machine has", sum(bool(r["impossible"]) for r in records), len(records), (0, 0)
        )
    )
    return [*lines, "  " + _times(records), ""]


def _times(records: Sequence[Record]) -> str:
    times = np.array([r["seconds"] for r in records])
    middle, long = np.quantile(times, [0.5, 0.95])
    return f"Time of a diagnosis: median {middle:.2f} s, 95 % below {long:.2f} s, at most {times.max():.1f} s"


def _side_by_side(records: Sequence[Record]) -> list[str]:
    if not records:
        return []
    names = list(dict.fromkeys(name for r in records for name in r["peers"]))
    innocent = [r for r in records if r["kind"] == "none"]
    one = [r for r in records if r["kind"] == "catalogue" and len(r["truth"]) == 1]
    two = [r for r in records if r["kind"] == "catalogue" and len(r["truth"]) == 2]
    outside = [r for r in records if r["kind"] == "outside"]
    lines = [
        "",
        f"Other methods on the same data ({len(records)} machines; effects by their own names only)",
        "",
    ]
    lines.append(
        f"  {'':<20}{'false claims':>14}{'effects':>9}{'first right':>13}{'one: exact':>12}{'two: exact':>12}"
        f"{'outside:':>12}{'held-out error,':>17}"
    )
    lines.append(
        f"  {'':<20}{'on innocent':>14}{'claimed':>9}{'':>13}{'':>12}{'':>12}{'effects':>12}{'true model = 1':>17}"
    )

    def mean(values: Sequence[Any], form: str, width: int) -> str:
        return f"{np.mean(values):>{width}{form}}" if len(values) else f"{'-':>{width}}"

    for name in names:

        def own(some: Sequence[Record], key: str, name: str = name) -> list[Any]:
            return [r["peers"][name][key] for r in some if name in r["peers"]]

        claims = own(innocent, "chosen")
        lines.append(
            f"  {name:<20}"
            + mean([claim > 0 for claim in claims], ".1%", 14)
            + mean(claims, ".2f", 9)
            + mean(own(one, "first"), ".1%", 13)
            + mean(own(one, "exact"), ".1%", 12)
            + mean(own(two, "exact"), ".1%", 12)
            + mean(own(outside, "chosen"), ".2f", 12)
            + mean(own(one + two, "held_out"), ".3f", 17)
        )
    return lines
