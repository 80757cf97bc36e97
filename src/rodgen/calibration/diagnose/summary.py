"""A diagnosis as text: the verdict, the error after each effect, each effect with its parameters, notes."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.checks.gross import on_outliers
from rodgen.calibration.words import (
    IN_UNCERTAINTIES,
    chance,
    fall,
    plain,
    probability,
    sized,
    three_digits,
    two_digits,
    uncapitalized,
)
from rodgen.data.units import readable, unit_factor
from rodgen.errors import joined
from rodgen.machines.effects.plausibility import plausibility, reach
from rodgen.statistics.thresholds import DETERMINACY, SELECTION, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.diagnose.diagnosis import Alias, DiagnosedEffect, Diagnosis, Unexplained
    from rodgen.calibration.fitted import Estimate
    from rodgen.machines.machine import Machine

WIDTH = 100
EQUAL_ODDS = 1.5
"""Odds, to 1, that are smaller are called equal."""
MOST_EXPLAINED = 4
"""Effects that may be there instead of one, each with a sentence on how well it does the same; others ..."""
MOST_NAMED = 6
"""... by name, as far as these."""
MOST_UNSEEN = 6
"""Effects that the data could not show, by name."""
MOST_HIDDEN = 5
"""Rows of the table of what could hide."""


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as a sentence, after one on wrong bounds of the machine file where there are any."""
    if diagnosis.wrong_bounds:
        return f"{diagnosis.wrong_bounds} Apart from that, {uncapitalized(_verdict(diagnosis))}"
    return _verdict(diagnosis)


def _verdict(diagnosis: Diagnosis) -> str:
    rms = diagnosis.rms
    before, after, unit = in_uncertainties(diagnosis) or (rms.before, rms.after, rms.unit)
    fallen = f"the error {fall(before, after, unit)}"
    names = joined([step.effect.title for step in diagnosis.steps])
    match diagnosis.verdict:
        case "nothing_missing":
            error = f"the error is {sized(before, unit)}"
            what = "Nothing is missing"
            correlation = diagnosis.correlation
            if correlation is not None and correlation.wanders and correlation.claimed:
                what = "No effect of the catalogue is missing"
                error += ", of which a part wanders in the order of the poses"
            unknown = ""
            if rms.noise is None:
                unknown = " How much of it is noise is not known: no pose was repeated, and none is stated."
            return f"{what} that these data could show; {error}.{unknown}"
        case "effects_missing":
            several = len(diagnosis.steps) > 1
            open_ = bool(diagnosis.indistinguishable_sets) or any(
                not alias.improbable
                for step in diagnosis.steps
                for alias in (*step.indistinguishable_from, *step.indistinguishable_pairs)
            )
            what = "These are missing" if several else "This is missing"
            others = ", or effects that do the same to these data" if open_ else ""
            return f"{what}{others}: {names}; {fallen}."
        case "unknown_effect":
            begin = f"In addition to {names}, something" if names else "Something"
            return f"{begin} outside the catalogue follows {drivers(diagnosis)}; {fallen}."
    return f"These data cannot tell: {diagnosis.reason}"


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
    """Return a sentence on effects that lower no error without others or forms; empty where there are none."""
    held_out = [diagnosis.rms.before_held_out, *(step.rms_held_out for step in diagnosis.steps)]
    alone = [
        step.effect.title
        for step, (before, after) in zip(diagnosis.steps, pairwise(held_out), strict=True)
        if before is not None and after is not None and after >= before
    ]
    if not alone:
        return ""
    others = [form.effect.title for form in diagnosis.unexplained]
    others = others or [s.effect.title for s in diagnosis.steps if s.effect.title not in alone]
    return f"{joined(alone)} lower{'s' * (len(alone) == 1)} the error only together with {joined(others)}."


def on_sets(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield a sentence on each two effects that the data cannot distinguish from others together."""
    for one in diagnosis.indistinguishable_sets:
        named, others = (joined([e.title for e in effects]) for effects in (one.named, one.effects))
        does = "explains" if len(one.effects) == 1 else "explain"
        yield (
            f"Of {named} both may not be there: {others} {does} these readings as well in their place; with these data "
            f"that is {_likelier(one.odds_with_data)}."
        )


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
        yield from _notes(d)
        return
    yield ""
    yield from _ladder(d)
    for step in d.steps:
        yield ""
        yield from _step(step, d.base.machine)
    for said in on_sets(d):
        yield ""
        yield from textwrap.wrap(said, WIDTH)
    for form in d.unexplained:
        yield ""
        yield from _form(form)
    if d.verdict == "nothing_missing" and d.ranking:
        best = d.ranking[0]
        yield ""
        why = f"chance explains as much ({chance(best.p_value)})"
        if best.p_value < SELECTION.family_wise:  # linear columns promised more than full fits hold
            why = "the fit of the whole model does not confirm it"
        nearest = f"Of {len(d.ranking)} candidates, {best.effect.title} comes nearest, but {why}."
        yield from textwrap.wrap(nearest, WIDTH)
        yield from _could_hide(d)
    unseen = [effect.title for effect in d.unseen]
    if unseen:
        yield ""
        yield from _paragraph("Not seen", f"These data could not show {joined(unseen, most=MOST_UNSEEN)}.")
    yield from _notes(d)


def _could_hide(d: Diagnosis) -> Iterator[str]:
    """Yield a table of the effects that could hide most error, with the least sizes that would have been found."""
    worst = d.could_hide[:MOST_HIDDEN]
    if not worst:
        return
    yield ""
    yield from textwrap.wrap(
        f"An effect up to this size could hide; a larger one would be found in {100 * VERDICT.power:.0f} % of such "
        "data or more. The error is what it does to the readings before a fit takes up its part of it:",
        WIDTH,
    )
    width = max(len(one.effect.title) for one in worst)
    for one in worst:
        factor, unit = readable(d.rms.unit, one.rms)
        error = f"{two_digits(one.rms * factor)} {unit}"
        yield f"  {one.effect.title:<{width}}  {one.text:<24}  {error:<12}  {one.how_rare}".rstrip()
    if len(d.could_hide) > len(worst):
        yield f"  and {len(d.could_hide) - len(worst)} more with less error, in --json"


def _ladder(d: Diagnosis) -> Iterator[str]:
    """Yield a table of the errors from model to model, then the noise and the outliers."""
    rms = d.rms
    rows = [("without bounds" if d.wrong_bounds else "as it is", d.base.rms, rms.before_held_out, "")]
    rows += [(f"+ {s.effect.title}", s.rms, s.rms_held_out, probability(s.p_value)) for s in d.steps]
    rows += [(f"+ {f.effect.title}", f.rms, f.rms_held_out, probability(f.p_value)) for f in d.unexplained]
    factor, unit = readable(rms.unit, max(d.base.rms, *(row[1] for row in rows)))
    header = f"rms in {unit} per reading"
    width = max(len(header), *(len(row[0]) for row in rows))
    yield f"{header:{width}}  {'fitted':>9}  {'held out':>9}  p"
    for title, fitted, held_out, by_chance in rows:
        shown = "-" if held_out is None else three_digits(held_out * factor)
        yield f"{title:{width}}  {three_digits(fitted * factor):>9}  {shown:>9}  {by_chance}".rstrip()
    if rms.noise is not None:
        yield f"{'noise':{width}}  {three_digits(rms.noise * factor):>9}"
    if only_together(d):
        yield only_together(d)
    if rms.before_test is not None and rms.after_test is not None:
        before, after = (three_digits(x * factor) for x in (rms.before_test, rms.after_test))
        yield f"On the further measurements: {before} before, {after} after."
    if out := on_outliers(d.final_with_forms, d.base.outliers):
        yield from textwrap.wrap(out, WIDTH)


def _step(step: DiagnosedEffect, machine: Machine) -> Iterator[str]:
    yield step.effect.title
    yield from _parameters(step.parameters)
    yield from _paragraph("", at_reach(step, machine))
    yield from _paragraph("Meaning", step.meaning)
    yield from _paragraph("Usual size", step.effect.definition.usual_size)
    yield from _paragraph("Unusual", far_from_usual(step, machine))
    yield from _paragraph("Remedy", step.effect.definition.remedy)
    for title, aliases in alias_lists(step):
        said = [f"{alias.why} {odds(alias)}" for alias in aliases[:MOST_EXPLAINED] if not alias.improbable]
        further = [" together with ".join(e.title for e in alias.effects) for alias in aliases[len(said) :]]
        if not said:
            yield from textwrap.wrap(
                f"{title}: {joined(further, most=MOST_NAMED)}.",
                WIDTH,
                initial_indent="  ",
                subsequent_indent="    ",
            )
            continue
        yield f"  {title}:"
        for text in [*said, *([f"nor from {joined(further, most=MOST_NAMED)}."] if further else [])]:
            unbroken = text.replace(" %", "\xa0%")
            wrapped = textwrap.wrap(unbroken, WIDTH, initial_indent="    - ", subsequent_indent="      ")
            yield from (line.replace("\xa0", " ") for line in wrapped)


def alias_lists(step: DiagnosedEffect) -> Iterator[tuple[str, list[Alias]]]:
    """Yield the titles of an effect's lists of aliases, possible and improbable, and these, the likeliest first."""
    for title, improbable in (
        ("These data cannot distinguish it from", False),
        ("Similar, but improbable with these data", True),
    ):
        listed = (*step.indistinguishable_from, *step.indistinguishable_pairs)
        every = sorted(listed, key=lambda alias: -alias.odds_with_data)
        aliases = [alias for alias in every if alias.improbable == improbable]
        if aliases:
            yield title, aliases


def at_reach(step: DiagnosedEffect, machine: Machine) -> str:
    """Return how large parameters per lever arm are at the machine's reach, as usual sizes are given; or nothing."""
    length = machine.length_unit
    arm = reach(machine)
    sizes = [
        f"{name} {two_digits(abs(e.value) * arm)} arcsec"
        for name, e in step.parameters.items()
        if e.unit == f"arcsec/{length}" and e.std and abs(e.value) > DETERMINACY.certain * e.std
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
            least = max(abs(e.value) - DETERMINACY.certain * e.std, 0.0) * factor
            if least > VERDICT.unusual * sizes[name].usual:
                times = abs(e.value) * factor / sizes[name].usual
                found.append(f"{name} is {two_digits(times)} times the size that is usual")
    if not found:
        return ""
    return (
        f"{joined(found)}. Few machines have so much: look for another cause, too, such as one not recorded."
    )


def odds(alias: Alias) -> str:
    """Return how likely an alias is before and with these data, compared with the effect that was named."""
    before, after = _likelier(alias.odds), _likelier(alias.odds_with_data)
    if before == after:
        return f"It is {before}, before these data as well as with them."
    return f"Before these data it is {before}, with them {after}."


def _likelier(odds: float) -> str:
    times = max(odds, 1 / max(odds, 1e-9))
    if times < EQUAL_ODDS:
        return "as likely"
    shown = f"{times:.0f}" if times < 1000 else "more than 1000"
    return f"{'likelier' if odds > 1 else 'less likely'} by {shown} to 1"


def _parameters(parameters: Mapping[str, Estimate]) -> Iterator[str]:
    least = {
        unit: min((e.std for e in parameters.values() if e.std and e.unit == unit), default=0.0)
        for unit in {e.unit for e in parameters.values()}
    }
    for name, e in parameters.items():
        std = e.std or 0.0
        unit = "" if e.unit == "1" else f" {e.unit}"
        hardly = std > DETERMINACY.hardly * least[e.unit] and abs(e.value) < DETERMINACY.certain * std
        yield f"  {name:<13}" + (
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
