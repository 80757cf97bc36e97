"""A diagnosis as text: the verdict, the error after each effect, each effect with its parameters, notes."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rodgen.calibration.gross_readings import on_outliers
from rodgen.calibration.pointing import pointing
from rodgen.calibration.repairs import digits_of, simplest
from rodgen.calibration.words import (
    IN_UNCERTAINTIES,
    UNWEIGHED,
    comparison,
    fall,
    odds_text,
    plain,
    sized,
    three_digits,
    two_digits,
    uncapitalized,
)
from rodgen.data.units import readable, unit_factor
from rodgen.errors import joined
from rodgen.machines.plausibility import plausibility, reach
from rodgen.statistics.digits import measured
from rodgen.statistics.thresholds import CHECK, COST, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Alias, DiagnosedEffect, Diagnosis, Unexplained
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.fitted import Estimate
    from rodgen.calibration.noise_floor import NoiseFloor
    from rodgen.machines.machine import Machine

HARDLY = 20.0
"""A parameter of an effect is hardly determined whose standard deviation is so many times that of another."""
CERTAIN = 4.0
"""Its value is within so many of its own standard deviations, too: other parameters make up for it."""

WIDTH = 100
MOST_IN_VERDICT = 2
"""Alternatives that the verdict names; of more it says how many there are."""
MOST_NAMED = 4
"""Alternatives of an effect that are listed."""
RATIOS = frozenset({"scale", "leg_scale"})
"""Effects that are a wrong ratio where they are large, or a fraction: of a gear, a pitch, or counts per turn."""
AT_NOISE = 1.15
"""An error up to this multiple of the noise agrees with it."""
MOST_UNSEEN = 6
"""Effects that the data could not show, by name."""
MOST_HIDDEN = 5
"""Rows of the table of what could hide."""


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as a sentence, after others on bounds and dimensions of the machine file that are wrong."""
    before = [text for text in (diagnosis.wrong_bounds, on_geometry(diagnosis)) if text]
    if diagnosis.verdict == "wrong_geometry":
        return " ".join(before)
    if before:
        return f"{' '.join(before)} Apart from that, {uncapitalized(_verdict(diagnosis))}"
    return _verdict(diagnosis)


def _verdict(diagnosis: Diagnosis) -> str:
    rms = diagnosis.rms
    if diagnosis.verdict == "cannot_tell":
        return f"These data cannot tell: {diagnosis.reason}"
    weighted = in_uncertainties(diagnosis)
    before, after, unit = weighted or (diagnosis.base.rms, rms.after, rms.unit)
    noise = "" if weighted else _against_noise(diagnosis, diagnosis.final_with_forms)
    if diagnosis.verdict == "nothing_missing":
        error = f"the error is {sized(before, unit)}"
        what = "Nothing is missing"
        correlation = diagnosis.correlation
        if correlation is not None and correlation.wanders and correlation.claimed:
            what = "No effect of the catalogue is missing"
            error += ", of which a part wanders in the order of the poses"
        unknown = ""
        if rms.noise is None:
            unknown = " How much of it is noise is not known: no pose was repeated, and none is stated."
        return f"{what} that these data could show; {error}{noise}.{unknown}"
    fallen = f"the error {fall(before, after, unit)}{noise}"
    names = joined([with_alternatives(step, diagnosis.base.machine) for step in diagnosis.steps])
    if diagnosis.verdict == "unknown_effect":
        begin = f"In addition to {names}, something" if names else "Something"
        what = f"{begin} outside the catalogue follows {drivers(diagnosis)}"
    else:
        what = f"{'These are' if len(diagnosis.steps) > 1 else 'This is'} missing: {names}"
    odds = diagnosis.odds
    sure = f" The odds for that are {odds_text(odds)} to 1." if odds > 1 else ""
    return f"{what}; {fallen}.{sure}"


def _against_noise(diagnosis: Diagnosis, fit: Fit) -> str:
    """Return how the error of a fit compares with the noise; empty where that is not known.

    Of n readings with r degrees of freedom noise leaves an error of √(r/n) of it, known to 1/√(2r). The noise by
    replicates is known to its interval.
    """
    noise = diagnosis.rms.noise
    if not noise:
        return ""
    shown = sized(noise, diagnosis.rms.unit)
    readings = max(fit.residuals.shape[1] * int(np.sum(~fit.outliers)), 1)
    dof = max(fit.degrees_of_freedom, 1)
    error, same = fit.rms / math.sqrt(dof / readings), max(AT_NOISE, 1 + 2 / math.sqrt(2 * dof))
    replicates = diagnosis.final.noise.replicates
    low, high = (replicates.low, replicates.high) if replicates else (noise, noise)
    if error < min(noise / same, low):
        source = "stated" if diagnosis.final.noise.source == "stated" else "the replicates say"
        return f", less than the noise ({shown}), which is smaller than {source}"
    return (
        f", which agrees with the noise ({shown})"
        if error <= max(same * noise, high)
        else f"; the noise is {shown}"
    )


def with_alternatives(step: DiagnosedEffect, machine: Machine) -> str:
    """Return the name of an effect, with those that are nearly as probable, or how many of them there are."""
    ratio = "a wrong ratio" if _is_ratio(step) and far_from_usual(step, machine) else ""
    near = [alias for alias in step.indistinguishable_from if -2 * math.log(alias.odds) < COST.needed]
    alone = [str(a.effect.place) for a in near if a in step.shares and step.effect not in a.effects]
    parts = [e.place for a in step.shares if step.effect in a.effects for e in a.effects if e != step.effect]
    where = [f"or at {joined(alone, 'or')}"] * bool(alone)
    where += [f"perhaps shared with {joined(map(str, parts), 'or')}"] * bool(parts)
    near = [alias for alias in near if alias not in step.shares]
    others = joined([together(alias) for alias in near])
    if len(near) > MOST_IN_VERDICT:
        others = f"{len(near)} others"
    return step.effect.titled(
        ratio, ", ".join(where), f"here indistinguishable from {others}" if near else ""
    )


def together(alias: Alias) -> str:
    """Return the effects of an alternative."""
    return " with ".join(effect.title for effect in alias.effects)


def on_geometry(diagnosis: Diagnosis) -> str:
    """Return a sentence on dimensions that are not those of the file; empty where they are."""
    geometry = diagnosis.geometry
    if geometry is None:
        return ""
    after, numbers = diagnosis.base.rms, joined([*_numbers(diagnosis)])
    fallen = fall(geometry.before.rms, after, diagnosis.rms.unit) + _against_noise(diagnosis, diagnosis.base)
    how = f"{numbers}; with that" if numbers else "with estimated ones"
    return (
        f"The dimensions of the machine are not those of the file: {how} the error {fallen}. That is "
        f"{comparison(geometry.odds, than=' than single effects in its place')}. "
        "'rodgen diagnose -o FILE' writes a machine file that estimates them."
    )


def _numbers(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield what the numbers are that all legs of a platform share, where these alone are wrong."""
    geometry, fit = diagnosis.geometry, diagnosis.final
    if geometry is None or geometry.effects:
        return
    kinematics, unit = fit.machine.kinematics, fit.machine.length_unit
    for name in (name for name in kinematics.numbers if name in geometry.estimate):
        for x, drawn in zip(kinematics.numbers[name], kinematics.number(name), strict=True):
            shown = f"{name}.{x}" if x else name
            one = fit.estimates[f"geometry.{shown}"]
            value, std = measured(drawn + one.value, one.std)
            yield f"{shown} is {value}{f' ± {std}' if one.std else ''} {unit}, not {drawn:.6g}"


def in_uncertainties(diagnosis: Diagnosis) -> tuple[float, float, str] | None:
    """Return the errors before and after in stated uncertainties, where these differ, and what to call that unit."""
    if not diagnosis.base.weighted:
        return None
    before, after = (
        float(np.sqrt(np.mean(fit.sizes[~fit.outliers] ** 2)))
        for fit in (diagnosis.base, diagnosis.final_with_forms)
    )
    return before, after, IN_UNCERTAINTIES


def only_together(diagnosis: Diagnosis) -> str:
    """Return a sentence on effects with which poses held out are predicted no better; empty where there are none.

    Where the fit weighs readings by what those of a pose share, plain errors do not tell.
    """
    if diagnosis.final.weighed:
        return UNWEIGHED
    alone = [
        step.effect.title
        for step, (before, after) in zip(diagnosis.steps, pairwise(diagnosis.fits), strict=True)
        if after.held_out().rises_from(before.held_out())
    ]
    others = [form.effect.title for form in diagnosis.unexplained]
    others = others or [s.effect.title for s in diagnosis.steps if s.effect.title not in alone]
    if not alone:
        return ""
    if not others:
        return f"Poses held out are predicted no better with {joined(alone)}."
    return f"{joined(alone)} lower{'s' * (len(alone) == 1)} the error only together with {joined(others)}."


def on_sets(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield a sentence on each set of effects that the data cannot distinguish from others together."""
    for one in diagnosis.indistinguishable_sets:
        named, others = (joined([e.title for e in effects]) for effects in (one.named, one.effects))
        fits = "fits" if len(one.effects) == 1 else "fit"
        yield f"In the place of {named}, {others} alone {fits} these data, {comparison(one.odds)}."


def how_to_distinguish(diagnosis: Diagnosis) -> str:
    """Return a sentence on the command that plans what would distinguish effects; empty where nothing is open."""
    machine, data = diagnosis.base.machine.file, diagnosis.base.observations.data.file
    alternatives = [step.indistinguishable_from for step in diagnosis.steps]
    if not any([*alternatives, diagnosis.indistinguishable_sets]) or not (machine and data):
        return ""
    return f"'{shlex.join(['rodgen', 'plan', machine, data])}' proposes readings that distinguish these."


def drivers(diagnosis: Diagnosis) -> str:
    """Return what the forms outside the catalogue follow, each driver once."""
    every = [name for form in diagnosis.unexplained for name in form.driver.split(" and ")]
    return joined(list(dict.fromkeys(plain(name) for name in every)))


def as_text(diagnosis: Diagnosis) -> str:
    """Return the whole diagnosis."""
    return "\n".join(_lines(diagnosis))


def _lines(d: Diagnosis) -> Iterator[str]:
    o = d.base.observations
    yield f"{d.base.machine.name}, {o.data.file}: {d.rows} rows"
    yield ""
    yield from textwrap.wrap(headline(d), WIDTH)
    if d.verdict == "cannot_tell":
        if d.ranking:
            yield ""
            yield from textwrap.wrap(nearest(d), WIDTH)
        yield from _notes(d)
        return
    yield ""
    yield from _ladder(d)
    on_sky = pointing(d.final_with_forms)
    if on_sky is not None:
        yield from textwrap.wrap(on_sky.sentence(d.base.rms if d.found else None), WIDTH)
    for steps in of_one_kind(d.steps):
        yield ""
        yield from of_effects(steps, d.base.machine)
    if on_sky is not None:
        yield ""
        yield from _paragraph(
            "TPOINT", joined([f"{term} {e.text}" for term, e in on_sky.terms.items()]) + "."
        )
    for said in on_sets(d):
        yield ""
        yield from textwrap.wrap(said, WIDTH)
    if text := how_to_distinguish(d):
        yield ""
        yield from textwrap.wrap(text, WIDTH)
    for form in d.unexplained:
        yield ""
        yield from _form(form)
    if d.verdict == "nothing_missing" and d.ranking:
        yield ""
        yield from textwrap.wrap(nearest(d), WIDTH)
        yield from _could_hide(d)
    unseen = [effect.title for effect in d.unseen]
    huge = [one.effect.title for one in d.could_hide if not one.possible]
    if unseen or huge:
        yield ""
    if unseen:
        yield from _paragraph("Not seen", f"These data could not show {joined(unseen, most=MOST_UNSEEN)}.")
    if huge:
        text = f"These data would show only more than any machine has of {joined(huge, most=MOST_UNSEEN)}."
        yield from _paragraph("Hardly seen", text)
    yield from _notes(d)


def nearest(diagnosis: Diagnosis) -> str:
    """Return a sentence on the candidate that comes nearest to a claim where none is named."""
    best, count = diagnosis.ranking[0], len(diagnosis.ranking)
    odds = best.odds
    needed = "" if odds < 1 else f"; a claim needs {odds_text(math.exp(COST.something / 2))}"
    if -2 * math.log(odds) < -COST.something:
        needed = "; full fits do not confirm it"
    return f"Of {count} candidates, {best.effect.title} comes nearest: {comparison(odds, than=' than none')}{needed}."


def _could_hide(d: Diagnosis) -> Iterator[str]:
    """Yield a table of the effects that could hide most error, with the least sizes that would have been found."""
    possible = [one for one in d.could_hide if one.possible]
    worst = possible[:MOST_HIDDEN]
    if not worst:
        return
    yield ""
    yield from textwrap.wrap(
        f"An effect up to this size could hide; a larger one would be found in {100 * VERDICT.power:.0f} % of such "
        "data or more. The second number is its error in the readings, before the fit absorbs a part of it:",
        WIDTH,
    )
    width = max(len(one.effect.title) for one in worst)
    for one in worst:
        factor, unit = readable(d.rms.unit, one.rms)
        error = f"{two_digits(one.rms * factor)} {unit}"
        yield f"  {one.effect.title:<{width}}  {one.text:<24}  {error:<12}  {one.how_rare}".rstrip()
    if len(possible) > len(worst):
        yield f"  and {len(possible) - len(worst)} more with less error, in --json"


class Rung(NamedTuple):
    """A model: what it has more than the one before, its errors, fitted and held out, and the odds for it in words."""

    title: str
    rms: float
    rms_held_out: float | None
    odds: str


def rungs(d: Diagnosis) -> list[Rung]:
    """Return the models of a diagnosis, from that of the file on."""
    rms = d.rms
    first = "without bounds" if d.wrong_bounds else "the file"
    found = [Rung(first, rms.before, rms.before_held_out, "")]
    if d.geometry is not None:
        odds = odds_text(d.geometry.odds)
        found.append(Rung("+ its dimensions", d.base.rms, d.base.held_out().rms, odds))
    titles = [step.effect.title for step in d.steps]
    for form in d.unexplained:
        place = f" at {form.joint}" if form.joint else ""
        titles.append(f"{plain(form.form, 30)}{place}, outside the catalogue")
    return found + [
        Rung(f"+ {title}", one.rms, one.rms_held_out, odds_text(one.odds))
        for title, one in zip(titles, d.found, strict=True)
    ]


def _ladder(d: Diagnosis) -> Iterator[str]:
    """Yield a table of the errors from model to model, then the noise and the outliers."""
    rms, rows = d.rms, rungs(d)
    factor, unit = readable(rms.unit, max(row.rms for row in rows))
    header = f"rms in {unit} per reading"
    floor = d.final.noise
    noise = "noise, by replicates" if floor.replicates else "noise"
    width = max(len(header), len(noise), *(len(row.title) for row in rows))
    yield f"{header:{width}}  {'fitted':>9}  {'held out':>9}  odds"
    for title, fitted, held_out, odds in rows:
        shown = "-" if held_out is None else three_digits(held_out * factor)
        yield f"{title:{width}}  {three_digits(fitted * factor):>9}  {shown:>9}  {odds}".rstrip()
    if rms.noise is not None:
        yield f"{noise:{width}}  {three_digits(rms.noise * factor):>9}{_known_to(floor, factor)}"
    fits = (d.base, d.final_with_forms)
    for said in (*dict.fromkeys(fit.held_out().note for fit in fits), only_together(d)):
        if said:
            yield from textwrap.wrap(said, WIDTH)
    if rms.before_test is not None and rms.after_test is not None:
        before, after = (three_digits(x * factor) for x in (rms.before_test, rms.after_test))
        yield f"On the further measurements: {before} before, {after} after."
    if out := on_outliers(d.final_with_forms, d.base.outliers):
        yield from textwrap.wrap(out, WIDTH)


def _known_to(floor: NoiseFloor, factor: float) -> str:
    """Return the 95 % interval of a noise estimated from replicates, and the stated noise; empty without replicates."""
    if floor.replicates is None:
        return ""
    low, high = (three_digits(x * factor) for x in (floor.replicates.low, floor.replicates.high))
    stated = "" if floor.stated is None else f"; stated: {three_digits(floor.stated * factor)}"
    return f"  {low} to {high} (95 %){stated}"


def of_one_kind(steps: Sequence[DiagnosedEffect]) -> list[list[DiagnosedEffect]]:
    """Return the steps, those of one effect at several places together."""
    kinds: dict[tuple[str, str], list[DiagnosedEffect]] = {}
    for step in steps:
        kinds.setdefault((step.effect.name, step.meaning), []).append(step)
    return [*kinds.values()]


def of_effects(steps: Sequence[DiagnosedEffect], machine: Machine) -> Iterator[str]:
    """Yield the lines on one effect, at one place or several."""
    effect, definition = steps[0].effect, steps[0].effect.definition
    many = len(steps) > 1
    yield f"{effect.name} at {joined([str(s.effect.place) for s in steps])}" if many else effect.title
    for step in steps:
        labelled = {step.effect.label(name): e for name, e in step.parameters.items()}
        yield from _parameters(labelled, f" at {step.effect.place}" if many else "")
        yield from _paragraph("", at_reach(step, machine))
        yield from _paragraph("Unusual", far_from_usual(step, machine))
        yield from _paragraph("Where", shares(step))
        for k, text in enumerate(alternatives(step)):
            yield from _paragraph("" if k else "Or", text)
    yield from _paragraph("Meaning", definition.meaning)
    yield from _paragraph("Usual size", definition.usual_size)
    yield from _paragraph("Remedy", definition.remedy)


def alternatives(step: DiagnosedEffect) -> list[str]:
    """Return what these data cannot distinguish from an effect, the most probable first, each with its odds."""
    others = [alias for alias in step.indistinguishable_from if alias not in step.shares]
    aliases = sorted(others, key=lambda alias: -alias.odds)
    found = [f"{together(alias)}, {comparison(alias.odds)}" for alias in aliases[:MOST_NAMED]]
    return [*found, *([f"{len(aliases) - MOST_NAMED} more, in --json"] if aliases[MOST_NAMED:] else [])]


def shares(step: DiagnosedEffect) -> str:
    """Return the odds of where an effect is, with those places that may have it, or a part of it; or nothing."""
    found = [((step.effect,), 1.0), *((a.effects, a.odds) for a in step.shares)][: MOST_NAMED + 1]
    least = min(odds for _, odds in found)
    where = [f"{joined([str(e.place) for e in some])}{' alone' * (len(some) == 1)}" for some, _ in found]
    odds = " : ".join(odds_text(odds / least).removesuffix(".0") for _, odds in found)
    said = f"Odds of {' to '.join(where)}: {odds}. These data do not tell how much is where."
    return said if step.shares else ""


def at_reach(step: DiagnosedEffect, machine: Machine) -> str:
    """Return how large parameters per lever arm are at the machine's reach, as usual sizes are given; or nothing."""
    length = machine.length_unit
    arm = reach(machine)
    sizes = [
        f"{name} {two_digits(abs(e.value) * arm)} arcsec"
        for name, e in step.parameters.items()
        if e.unit == f"arcsec/{length}" and e.std and abs(e.value) > CERTAIN * e.std
    ]
    return (
        f"At a lever arm of {three_digits(arm)} {length}, the machine's reach: {joined(sizes)}."
        if sizes
        else ""
    )


def far_from_usual(step: DiagnosedEffect, machine: Machine) -> str:
    """Return a sentence on sizes that few machines have; empty where there are none."""
    sizes = plausibility(machine, step.effect).sizes
    found = []
    for name, e in step.parameters.items():
        if name in sizes and e.std is not None:
            factor = unit_factor(e.unit, machine.length_unit)[0]
            least = max(abs(e.value) - CERTAIN * e.std, 0.0) * factor
            if least > VERDICT.unusual * sizes[name].usual:
                times = abs(e.value) * factor / sizes[name].usual
                found.append(f"{name} is {two_digits(times)} times the size that is usual")
    if not found:
        return ""
    if _is_ratio(step):
        return f"{joined(found)}: {on_ratio(step, machine)}"
    other = ", or a wrong ratio" if step.effect.name in RATIOS else ""
    return f"{joined(found)}. Few machines have so much: look for another cause, too, such as one not recorded{other}."


def _is_ratio(step: DiagnosedEffect) -> bool:
    """Return whether an effect is rather a wrong ratio: of its size, or since that is a fraction of small numbers."""
    if step.effect.name not in RATIOS:
        return False
    e = step.parameters["k"]
    return abs(e.value) > CHECK.imperfect or simplest(1 + e.value, CERTAIN * (e.std or 0.0)) is not None


def on_ratio(step: DiagnosedEffect, machine: Machine) -> str:
    """Return that the ratio of a joint is wrong in the file, what it is, and what to write there."""
    e, joint = step.parameters["k"], machine.joints[machine.number_of(str(step.effect.place))]
    fraction, text = simplest(1 + e.value, CERTAIN * (e.std or 0.0)), digits_of(1 + e.value, e.std or 0.0)
    near = "" if fraction is None else f" ({fraction} is within that)"
    written = f', or write reading = "{joint.column}", coordinate = "{text}*{joint.column}"'
    change = "" if machine.kinematics.is_closed or joint.coordinate or joint.reading else written
    return (
        f"the ratio of {joint.name} is wrong. It {'turns' if joint.revolute else 'moves'} by "
        f"{replace(e, value=1 + e.value).text} of what it reads{near}: correct it in the control{change}."
    )


def _parameters(parameters: Mapping[str, Estimate], place: str = "") -> Iterator[str]:
    least = {
        unit: min((e.std for e in parameters.values() if e.std and e.unit == unit), default=0.0)
        for unit in {e.unit for e in parameters.values()}
    }
    for name, e in parameters.items():
        std = e.std or 0.0
        unit = "" if e.unit == "1" else f" {e.unit}"
        hardly = std > HARDLY * least[e.unit] and abs(e.value) < CERTAIN * std
        yield f"  {f'{name}{place}':<12} " + (
            f"hardly determined by these data (± {two_digits(std)}{unit})" if hardly else e.text
        )


def _form(form: Unexplained) -> Iterator[str]:
    yield f"Outside the catalogue: {form.effect.title}, which follows {form.driver}"
    yield f"  {form.effect.definition.equation}"
    yield from _parameters(form.parameters)
    yield "  For the machine file, where 'rodgen diagnose -o' puts it, too:"
    yield from (f"    {line}" for line in form.block.strip().splitlines())


def _notes(d: Diagnosis) -> Iterator[str]:
    for note in d.notes:
        yield ""
        yield from textwrap.wrap(note, WIDTH)


def _paragraph(title: str, text: str) -> Iterator[str]:
    if text:
        yield from textwrap.wrap(
            text, WIDTH, initial_indent=f"  {title:<13}", subsequent_indent=" " * 15, break_on_hyphens=False
        )
