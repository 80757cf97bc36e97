"""What a diagnosis says: the verdict, the error after each effect, each effect with its parameters, notes."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.error_table import THE_FILE, Model, error_table, on_replicates
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
from rodgen.document import Block, Code, Document, Facts, Paragraph, Part, Table
from rodgen.errors import joined
from rodgen.machines.plausibility import plausibility, reach
from rodgen.statistics.digits import measured
from rodgen.statistics.thresholds import CHECK, COST, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import DiagnosedEffect, Diagnosis, Unexplained, WrongGeometry
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.fitted import Estimate
    from rodgen.machines.machine import Effect, Machine

HARDLY = 20.0
"""A parameter of an effect is hardly determined whose standard deviation is so many times that of another."""
CERTAIN = 4.0
"""Its value is within so many of its own standard deviations, too: other parameters make up for it."""

MOST_IN_VERDICT = 2
"""Alternatives that the verdict names; of more it says how many there are."""
MOST_NAMED = 4
"""Alternatives of an effect that are listed."""
RATIOS = frozenset({"scale", "leg_scale"})
"""Effects that are a wrong ratio where they are large, or a fraction: of a gear, a pitch, or counts per turn."""
AT_NOISE = 1.15
"""An error up to this multiple of the noise agrees with it."""
NEAR = 100.0
"""Distance in mm from the middle of a plate at which its height error is stated."""
MOST_UNSEEN = 6
"""Effects that the data could not show, by name."""
MOST_HIDDEN = 5
"""Rows of the table of what could hide."""


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as a sentence, after others on bounds and dimensions of the machine file that are wrong."""
    *before, (what, error) = statements(diagnosis)
    if not before:
        return what + error
    apart = f"Apart from that, {uncapitalized(what)}" if diagnosis.verdict != "wrong_geometry" else what
    return " ".join([*("".join(one) for one in before), apart + error])


def statements(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return what the diagnosis says, the verdict last: each a statement, and what follows it in its sentence."""
    pairs = [(diagnosis.wrong_bounds, ""), on_geometry(diagnosis)]
    if diagnosis.verdict != "wrong_geometry":
        pairs.append(_verdict(diagnosis))
    return [one for one in pairs if one[0]]


def _verdict(diagnosis: Diagnosis) -> tuple[str, str]:
    rms = diagnosis.rms
    if diagnosis.verdict == "cannot_tell":
        return "These data cannot tell", f": {diagnosis.reason}"
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
        return f"{what} that these data could show", f"; {error}{noise}.{unknown}"
    fallen = f"the error {fall(before, after, unit)}{noise}"
    names = joined([with_alternatives(step, diagnosis.base.machine) for step in diagnosis.steps])
    if diagnosis.verdict == "unknown_effect":
        begin = f"In addition to {names}, something" if names else "Something"
        what = f"{begin} outside the catalogue follows {drivers(diagnosis)}"
    else:
        what = f"{'These are' if len(diagnosis.steps) > 1 else 'This is'} missing: {names}"
    odds = diagnosis.odds
    sure = f" The odds for that are {odds_text(odds)} to 1." if odds > 1 else ""
    return what, f"; {fallen}.{sure}"


def _against_noise(diagnosis: Diagnosis, fit: Fit) -> str:
    """Return how the error of a fit compares with the noise; empty where that is not known.

    Of n readings with r degrees of freedom noise leaves an error of √(r/n) of it, known to 1/√(2r). The noise by
    replicates is known to its interval.
    """
    noise = diagnosis.rms.noise
    if not noise:
        return ""
    noise_text = sized(noise, diagnosis.rms.unit)
    readings = max(fit.residuals.shape[1] * int(np.sum(~fit.outliers)), 1)
    dof = max(fit.degrees_of_freedom, 1)
    error, same = fit.rms / math.sqrt(dof / readings), max(AT_NOISE, 1 + 2 / math.sqrt(2 * dof))
    replicates = diagnosis.final.noise.replicates
    low, high = (replicates.low, replicates.high) if replicates else (noise, noise)
    if error < min(noise / same, low):
        source = "stated" if diagnosis.final.noise.source == "stated" else "the replicates say"
        return f", less than the noise ({noise_text}), which is smaller than {source}"
    return (
        f", which agrees with the noise ({noise_text})"
        if error <= max(same * noise, high)
        else f"; the noise is {noise_text}"
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
    others = joined([together(alias.effects) for alias in near])
    if len(near) > MOST_IN_VERDICT:
        others = f"{len(near)} others"
    return step.effect.titled(
        ratio or of_all_legs(step, machine),
        ", ".join(where),
        f"here indistinguishable from {others}" if near else "",
    )


def of_all_legs(step: DiagnosedEffect, machine: Machine) -> str:
    """Return what an effect of all legs says of the machine; empty of others."""
    e, dimension = next(iter(step.parameters.values())), machine.kinematics.dimension(step.effect.name)
    if step.effect.name == "common_zero_offset":
        return f"the zeros of all {machine.kinematics.leg}s are off alike by {e.text}"
    return "" if dimension is None else f"the {dimension[0]} is {_dimension(dimension[1], e)}"


def _dimension(drawn: float, e: Estimate) -> str:
    """Return what a dimension is, and what it is in the file."""
    value, std = measured(drawn + e.value, e.std)
    return f"{value}{f' ± {std}' if e.std else ''} {e.unit}, not {drawn:.6g}"


def together(effects: Sequence[Effect]) -> str:
    """Return the effects of an alternative."""
    return " with ".join(effect.title for effect in effects)


def on_geometry(diagnosis: Diagnosis) -> tuple[str, str]:
    """Return a statement on dimensions that are not those of the file, and what follows it; empty where they are."""
    geometry = diagnosis.geometry
    if geometry is None:
        return "", ""
    after, numbers = diagnosis.base.rms, "; ".join(_numbers(diagnosis))
    fallen = fall(geometry.before.rms, after, diagnosis.rms.unit) + _against_noise(diagnosis, diagnosis.base)
    how = f"{numbers}; with that" if numbers else "with estimated ones"
    return (
        "The dimensions of the machine are not those of the file",
        f": {how} the error {fallen}. That is "
        f"{comparison(geometry.odds, than=' than single effects in its place')}. {_instead(geometry)}"
        "'rodgen diagnose -o FILE' writes a machine file that estimates them.",
    )


def _instead(geometry: WrongGeometry) -> str:
    """Return a sentence on what the data cannot distinguish from numbers that all legs share; empty without."""
    clauses = [
        f"{together(one.named)} is indistinguishable from {together(one.effects)}, {comparison(one.odds)}"
        for one in geometry.alternatives[:MOST_NAMED]
    ]
    return f"Here {'; '.join(clauses)}. " if clauses else ""


def _numbers(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield what the numbers are that all legs of a platform share, where these alone are wrong."""
    geometry, fit = diagnosis.geometry, diagnosis.final
    if geometry is None or geometry.effects:
        return
    kinematics = fit.machine.kinematics
    before = geometry.before.machine.estimate
    for name in (name for name in kinematics.numbers if name in geometry.estimate and name not in before):
        for x, drawn in zip(kinematics.numbers[name], kinematics.number(name), strict=True):
            key = f"{name}.{x}" if x else name
            one = fit.estimates[f"geometry.{key}"]
            if not x or abs(one.value) > 2 * (one.std or 0.0):
                yield f"{key} is {_dimension(drawn, one)}"


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
        yield f"Instead of {named}, {others} alone {fits} these data, {comparison(one.odds)}."


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


def document(d: Diagnosis) -> Document:
    """Return the whole diagnosis."""
    return Document(
        list(_blocks(d)), f"{d.base.machine.name}, {d.base.observations.data.file}: {d.rows} rows"
    )


def _blocks(d: Diagnosis) -> Iterator[Block]:
    yield Part([Paragraph(headline(d))])
    if d.verdict == "cannot_tell":
        if d.ranking:
            yield Part([Paragraph(nearest(d))])
    else:
        yield Part(list(on_errors(d)))
        yield from causes(d)
        yield from list(on_pointing(d))
        yield from what_could_hide(d)
        yield from not_seen(d)
    yield from (Part([Paragraph(note)]) for note in d.notes)


def causes(d: Diagnosis, more: Callable[[DiagnosedEffect], Facts] | None = None) -> Iterator[Part]:
    """Yield a part for each effect that was found, then what distinguishes them, and the forms.

    Parameters
    ----------
    more : callable, optional
        From an effect to what else there is to say of it; then all alternatives are listed.
    """
    for steps in of_one_kind(d.steps):
        part = of_effects(steps, d.base.machine, None if more else MOST_NAMED)
        further = [] if more is None else [fact for step in steps for fact in more(step).said]
        yield replace(
            part, blocks=[*part.blocks, *([Facts(list(dict.fromkeys(further)))] if further else [])]
        )
    yield from (Part([Paragraph(sentence)]) for sentence in (*on_sets(d), how_to_distinguish(d)) if sentence)
    yield from map(_form, d.unexplained)


def on_pointing(d: Diagnosis) -> Iterator[Part]:
    """Yield the model of a mount as terms of TPOINT."""
    on_sky = pointing(d.final_with_forms)
    if on_sky is not None and d.verdict != "cannot_tell":
        yield Part(
            [Facts([(term, e.text) for term, e in on_sky.terms.items()])], "The model in TPOINT's terms"
        )


def nearest(diagnosis: Diagnosis) -> str:
    """Return a sentence on the candidate that comes nearest to a claim where none is named."""
    best, count = diagnosis.ranking[0], len(diagnosis.ranking)
    odds = best.odds
    needed = "" if odds < 1 else f"; a claim needs {odds_text(math.exp(COST.something / 2))}"
    if -2 * math.log(odds) < -COST.something:
        needed = "; full fits do not confirm it"
    return f"Of {count} candidates, {best.effect.title} comes nearest: {comparison(odds, than=' than none')}{needed}."


def what_could_hide(d: Diagnosis) -> Iterator[Part]:
    """Yield the candidate that comes nearest, then the effects that could hide most error, with their least sizes."""
    if d.verdict != "nothing_missing" or not d.ranking:
        return
    yield Part([Paragraph(nearest(d))])
    rows = []
    for one in (one for one in d.could_hide if one.possible):
        factor, unit = readable(d.rms.unit, one.rms)
        rows.append((one.effect.title, one.text, f"{two_digits(one.rms * factor)} {unit}", one.how_rare))
    text = (
        f"An effect up to this size could hide; a larger one would be found in {100 * VERDICT.power:.0f} % of such "
        "data or more. The second number is its error in the readings, before the fit absorbs a part of it:"
    )
    table = Table((), rows, most=MOST_HIDDEN, more="more with less error, in --json")
    yield from [Part([Paragraph(text), table])] * bool(rows)


def not_seen(d: Diagnosis) -> Iterator[Part]:
    """Yield the effects that these data could not show, or only where they are larger than on any machine."""
    unseen = [effect.title for effect in d.unseen]
    huge = [one.effect.title for one in d.could_hide if not one.possible]
    rows = [
        ("Not seen", f"These data could not show {joined(unseen, most=MOST_UNSEEN)}."),
        (
            "Hardly seen",
            f"These data would show only more than any machine has of {joined(huge, most=MOST_UNSEEN)}.",
        ),
    ]
    facts = [row for row, names in zip(rows, (unseen, huge), strict=True) if names]
    yield from [Part([Facts(facts)])] * bool(facts)


def rungs(d: Diagnosis) -> list[Model]:
    """Return the models of a diagnosis, from that of the file on."""
    rms = d.rms
    first = "without bounds" if d.wrong_bounds else THE_FILE
    models = [Model(first, rms.before, rms.before_held_out, "", rms.before_test)]
    if d.geometry is not None:
        held_out, odds = d.base.held_out().rms, odds_text(d.geometry.odds)
        models.append(Model("+ its dimensions", d.base.rms, held_out, odds))
    titles = [step.effect.title for step in d.steps]
    for form in d.unexplained:
        place = f" at {form.joint}" if form.joint else ""
        titles.append(f"{plain(form.form, 30)}{place}, outside the catalogue")
    models += [
        Model(f"+ {title}", one.rms, one.rms_held_out, odds_text(one.odds))
        for title, one in zip(titles, d.found, strict=True)
    ]
    return [*models[:-1], models[-1]._replace(rms_test=rms.after_test)] if len(models) > 1 else models


def on_errors(d: Diagnosis) -> Iterator[Block]:
    """Yield the errors from model to model, with the noise; then what there is to say of them and of outliers."""
    models, noise = rungs(d), d.final.noise
    yield error_table(models, d.rms.unit, noise)
    fits = (d.base, d.final_with_forms)
    notes = [
        on_replicates(models, d.rms.unit, noise),
        *dict.fromkeys(fit.held_out().note for fit in fits),
        only_together(d),
    ]
    notes.append(on_outliers(d.final_with_forms, d.base.outliers))
    if on_sky := pointing(d.final_with_forms):
        notes.append(on_sky.sentence(d.base.rms if d.found else None))
    yield from (Paragraph(text) for text in notes if text)


def of_one_kind(steps: Sequence[DiagnosedEffect]) -> list[list[DiagnosedEffect]]:
    """Return the steps, those of one effect at several places together."""
    kinds: dict[tuple[str, str], list[DiagnosedEffect]] = {}
    for step in steps:
        kinds.setdefault((step.effect.name, step.meaning), []).append(step)
    return [*kinds.values()]


def of_effects(steps: Sequence[DiagnosedEffect], machine: Machine, most: int | None = MOST_NAMED) -> Part:
    """Return what there is to say of one effect, at one place or several, with so many alternatives or all."""
    effect, definition = steps[0].effect, steps[0].effect.definition
    many = len(steps) > 1
    rows: list[tuple[str, str]] = []
    for step in steps:
        labelled = {step.effect.label(name): e for name, e in step.parameters.items()}
        rows += _parameters(labelled, f" at {step.effect.place}" if many else "")
        rows += [
            ("", at_reach(step, machine)),
            ("Unusual", far_from_usual(step, machine)),
            ("Where", shares(step)),
        ]
        rows += [("" if k else "Or", text) for k, text in enumerate(alternatives(step, most))]
    rows += [
        ("Meaning", definition.meaning),
        ("Usual size", definition.usual_size),
        ("Remedy", definition.remedy),
    ]
    title = f"{effect.name} at {joined([str(s.effect.place) for s in steps])}" if many else effect.title
    return Part([Facts(rows)], title, "effect")


def alternatives(step: DiagnosedEffect, most: int | None = MOST_NAMED) -> list[str]:
    """Return what these data cannot distinguish from an effect, the most probable first, each with its odds."""
    others = [alias for alias in step.indistinguishable_from if alias not in step.shares]
    names_and_odds = [
        f"{together(alias.effects)}, {comparison(alias.odds)}"
        for alias in sorted(others, key=lambda a: -a.odds)
    ]
    listed = names_and_odds[:most]
    more = len(names_and_odds) - len(listed)
    return [*listed, *([f"{more} more, in --json"] if more else [])]


def shares(step: DiagnosedEffect) -> str:
    """Return the odds of where an effect is, with those places that may have it, or a part of it; or nothing."""
    named = [((step.effect,), 1.0), *((a.effects, a.odds) for a in step.shares)][: MOST_NAMED + 1]
    least = min(odds for _, odds in named)
    where = [f"{joined([str(e.place) for e in some])}{' alone' * (len(some) == 1)}" for some, _ in named]
    odds = " : ".join(odds_text(odds / least).removesuffix(".0") for _, odds in named)
    sentence = f"Odds of {' to '.join(where)}: {odds}. These data do not tell how much is where."
    return sentence if step.shares else ""


def at_reach(step: DiagnosedEffect, machine: Machine) -> str:
    """Return how large parameters per length are, as usual sizes are given: lever arms at the machine's reach."""
    length = machine.length_unit
    if step.effect.definition.component == "plate":
        near = NEAR * unit_factor("mm", length)[0]
        heights = (f"{name} {two_digits(e.value * near**2)} {length}" for name, e in step.parameters.items())
        return f"At {three_digits(near)} {length} from the middle: {joined(list(heights))}."
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
    clauses = []
    for name, e in step.parameters.items():
        if name in sizes and e.std is not None:
            factor = unit_factor(e.unit, machine.length_unit)[0]
            least = max(abs(e.value) - CERTAIN * e.std, 0.0) * factor
            if least > VERDICT.unusual * sizes[name].usual:
                times = abs(e.value) * factor / sizes[name].usual
                clauses.append(f"{name} is {two_digits(times)} times the size that is usual")
    if not clauses:
        return ""
    if _is_ratio(step):
        return f"{joined(clauses)}: {on_ratio(step, machine)}"
    also = ", or a wrong ratio" if step.effect.name in RATIOS else ""
    return f"{joined(clauses)}. Few machines have so much: look for another cause, too, such as one not recorded{also}."


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


def _parameters(parameters: Mapping[str, Estimate], place: str = "") -> Iterator[tuple[str, str]]:
    least = {
        unit: min((e.std for e in parameters.values() if e.std and e.unit == unit), default=0.0)
        for unit in {e.unit for e in parameters.values()}
    }
    for name, e in parameters.items():
        std = e.std or 0.0
        unit = "" if e.unit == "1" else f" {e.unit}"
        hardly = std > HARDLY * least[e.unit] and abs(e.value) < CERTAIN * std
        text = f"hardly determined by these data (± {two_digits(std)}{unit})" if hardly else e.text
        yield f"{name}{place}", text


def _form(form: Unexplained) -> Part:
    rows = [("Formula", form.effect.definition.equation), *_parameters(form.parameters)]
    rows.append(("Machine file", "'rodgen diagnose -o' writes it with these lines:"))
    block = Code(form.block.strip(), "Copy the effect for the machine file")
    title = f"Outside the catalogue: {form.effect.title}, which follows {form.driver}"
    return Part([Facts(rows), block], title, "effect")
