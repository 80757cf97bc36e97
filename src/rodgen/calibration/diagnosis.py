"""The result of a diagnosis: the verdict, the effects found one after the other, and what they leave unexplained."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from rodgen.calibration.fitted import Estimate
from rodgen.calibration.open_questions import OpenQuestions
from rodgen.calibration.pointing import pointing
from rodgen.document import Document, Documented
from rodgen.errors import joined
from rodgen.machines.effects.catalogue import GEOMETRY
from rodgen.machines.files.write import effect_text
from rodgen.machines.machine import Effect, Machine
from rodgen.methods import method
from rodgen.statistics.thresholds import COST
from rodgen.views import Records, Result, plain

if TYPE_CHECKING:
    from rodgen.calibration.dependence import Correlation
    from rodgen.calibration.detectable import Detectable
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.data.set_aside import SetAside

EXCLUDED = "outlier of the diagnosis"
"""Why outliers are set aside, in the machine file."""
VERDICTS = {
    "nothing_missing": "nothing is missing",
    "effects_missing": "effects are missing",
    "wrong_geometry": "dimensions that are not those of the file",
    "unknown_effect": "effects outside the catalogue",
    "cannot_tell": "the data cannot tell",
}
"""The verdicts, with a few words on each."""


class HasOdds:
    """What a diagnosis says, with odds."""

    log10_odds: float

    @property
    def odds(self) -> float:
        """How many times as probable the readings are with it as without it; at most 1e300."""
        return odds_of(self.log10_odds)


@dataclass(frozen=True)
class Rms(Result):
    """Errors per scalar reading, in `unit`, without outliers; None where there is none.

    Attributes
    ----------
    before, after : float
        Of the model as it was, and with the effects and forms that were found.
    before_held_out, after_held_out : float or None
        On whole poses that the fit did not see.
    noise : float or None
        By replicates, else as stated.
    unit : str
    before_test, after_test : float or None
        On further measurements.
    not_held_out : mapping of str to str, or None
        Where an error on such poses is None: the ``reason``, a word as of `HeldOut` or "undecidable", and a ``text``.
    """

    before: float
    after: float
    before_held_out: float | None
    after_held_out: float | None
    noise: float | None
    unit: str
    before_test: float | None = None
    after_test: float | None = None
    not_held_out: Mapping[str, str] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return them as plain data, with the errors on further measurements where there are any."""
        tested = self.before_test is not None or self.after_test is not None
        names = "before after before_held_out after_held_out noise unit"
        return plain(self, f"{names} before_test after_test" if tested else names)


@dataclass(frozen=True, repr=False)
class Alias(Result):
    """An effect, or several together, that the data cannot distinguish from one that was found.

    Attributes
    ----------
    effects : tuple of Effect
        One or more.
    odds : float
        How many times as probable as the effect found it is, given the readings and what such machines have. The effect
        found is the most probable one, as far as formulas are exact.
    """

    effects: tuple[Effect, ...]
    odds: float

    @property
    def effect(self) -> Effect:
        """The first of them."""
        return self.effects[0]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"effects": [_named(e) for e in self.effects], "odds": _rounded(self.odds)}


@dataclass(frozen=True)
class SetAlias:
    """What the data cannot distinguish from several of the effects that were found, taken together."""

    named: tuple[Effect, ...]
    """The several."""
    effects: tuple[Effect, ...]
    """What may be there instead of all of them."""
    odds: float
    """How many times as probable it is as the several."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "steps": [_named(e) for e in self.named],
            "effects": [_named(e) for e in self.effects],
            "odds": _rounded(self.odds),
        }


@dataclass(frozen=True, repr=False)
class DiagnosedEffect(HasOdds, Result):
    """An effect that the data show to be missing.

    Attributes
    ----------
    effect : Effect
        :meth:`rodgen.machines.machine.Machine.add` takes this object, too.
    log10_odds : float
        Logarithm of how many times as probable what was found is with the effect as without it, given the readings.
    rms, rms_held_out : float, float or None
        Of the model up to this one.
    parameters : mapping of str to Estimate
        Of the final model, by their short names.
    indistinguishable_from : tuple of Alias
        What may be there in its place, the most probable first.
    """

    effect: Effect
    log10_odds: float
    rms: float
    rms_held_out: float | None
    parameters: Mapping[str, Estimate]
    indistinguishable_from: tuple[Alias, ...] = ()

    @property
    def shares(self) -> tuple[Alias, ...]:
        """Of these the same effect at other places, or at several that share it."""
        return tuple(
            a for a in self.indistinguishable_from if {e.name for e in a.effects} == {self.effect.name}
        )

    @property
    def shared_by(self) -> tuple[Effect, ...]:
        """It and the same effect at other places, such as parallel joints, where the data do not say its parts."""
        return tuple(dict.fromkeys([self.effect, *(e for a in self.shares for e in a.effects)]))

    @property
    def meaning(self) -> str:
        """What is physically there."""
        return self.effect.definition.meaning

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            **_named(self.effect),
            **plain(self, "odds rms rms_held_out"),
            "parameters": _estimates(self.parameters),
            **plain(self, "indistinguishable_from meaning"),
            **({"shared_by": [e.place for e in self.shared_by]} if self.shares else {}),
            **({"definition": self._definition} if self.effect.definition.own else {}),
        }

    @property
    def _definition(self) -> dict[str, Any]:
        """The keys of an ``[[effect]]`` of a machine file, of an effect that is none of the catalogue."""
        definition = self.effect.definition
        return {
            "name": definition.name,
            "joint": self.effect.place,
            "component": definition.component,
            "formula": definition.formula.text,
            "parameters": dict(definition.parameters),
            "meaning": definition.meaning,
        }


@dataclass(frozen=True)
class Ranked(HasOdds):
    """A candidate, weighed on the model without it.

    Attributes
    ----------
    effect : Effect
    log10_odds : float
        Logarithm of how many times as probable the model is with it as without anything.
    visible : float
        Share, 0 to 1, of the effect's change of the readings that the model's parameters cannot imitate.
    explains : float
        Share of the sum of squares that it removes.
    """

    effect: Effect
    log10_odds: float
    visible: float
    explains: float


@dataclass(frozen=True, repr=False)
class Unexplained(HasOdds, Result):
    """A form of what no effect of the catalogue explains, as an effect of the user's own.

    Attributes
    ----------
    effect : Effect
        :meth:`rodgen.machines.machine.Machine.add` takes this object, too.
    driver : str
        The joint or column that it follows.
    log10_odds : float
        As of an effect.
    rms, rms_held_out : float, float or None
        Of the model with everything up to this form, in the diagnosis' unit.
    parameters : mapping of str to Estimate
        Of the final model, by their short names.
    fit : Fit
        Of the model with everything up to this form.
    """

    effect: Effect
    driver: str
    log10_odds: float
    rms: float
    rms_held_out: float | None
    parameters: Mapping[str, Estimate]
    fit: Fit = field(repr=False, compare=False)

    @property
    def component(self) -> str:
        """What it changes: ``reading``, or one of ``tx ty tz rx ry rz``."""
        return self.effect.definition.component

    @property
    def joint(self) -> str | None:
        """Where; None for the whole machine."""
        return self.effect.place

    @property
    def form(self) -> str:
        """It in the words of users' formulas."""
        return self.effect.definition.formula.text

    @property
    def block(self) -> str:
        """An ``[[effect]]`` for the machine file."""
        return effect_text(self.fit.machine, self.effect)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data; `effect` has the keys of an ``[[effect]]`` of a machine file."""
        return {
            **plain(self, "driver component joint form odds rms rms_held_out"),
            "parameters": _estimates(self.parameters),
            "effect": tomllib.loads(self.block)["effect"][0],
        }


@dataclass(frozen=True, repr=False)
class WrongGeometry(HasOdds, Result):
    """The dimensions of the machine are not those of the file: they were estimated before effects were looked for.

    Attributes
    ----------
    estimate : tuple of str
        What the machine file then estimates.
    effects : tuple of Effect
        Those of dimensions of single legs, which it then has, too.
    log10_odds : float
        Logarithm of how many times as probable that is as the effects that would take its place.
    before : Fit
        Of the file's dimensions.
    rms_held_out : float or None
        With these, on poses left out.
    alternatives : tuple of SetAlias
        What the readings do not tell from numbers that all legs share, the most probable first.
    """

    estimate: tuple[str, ...]
    effects: tuple[Effect, ...]
    log10_odds: float
    before: Fit = field(repr=False)
    rms_held_out: float | None
    alternatives: tuple[SetAlias, ...] = ()

    _keys = "estimate effects=titles odds rms=before.rms rms_held_out alternatives"

    @property
    def titles(self) -> tuple[str, ...]:
        """Names of these effects, with their places."""
        return tuple(effect.title for effect in self.effects)


@dataclass(frozen=True, repr=False)
class Diagnosis(HasOdds, Documented, Result):
    """The effects that a model lacks, and the verdict, found from data alone.

    Attributes
    ----------
    verdict : {"nothing_missing", "effects_missing", "wrong_geometry", "unknown_effect", "cannot_tell"}
    reason : str or None
        Why the data allow no answer.
    rows : int
    outliers : tuple of int
        Rows, from 0, that were left out.
    rms : Rms
    steps : Records of DiagnosedEffect
        A tuple, in the order of adding; a DataFrame by ``to_pandas()``.
    unexplained : Records of Unexplained
    ranking : tuple of Ranked
        Every candidate, scored on the model as it was, best first.
    fits : tuple of Fit
        Of the model as it was, then after each step.
    correlation : Correlation or None
        Of the readings' errors.
    notes : tuple of str
        Further sentences, such as on a set-up that wanders.
    estimates : mapping of str to Estimate
        Every parameter of the final model by its key, with standard deviations that allow for correlated readings.
    could_hide : tuple of Detectable
        With the verdict "nothing_missing": the least size of each effect that would have been found, most error first.
    indistinguishable_sets : tuple of SetAlias
        Of two steps or more each, the most probable first.
    log10_odds : float
        Logarithm of how many times as probable all that was found is as nothing.
    geometry : WrongGeometry or None
        Where the dimensions are not those of the file; `fits` and `steps` are with estimated ones then.
    wrong_bounds : str
        A sentence on bounds of the machine file that the readings contradict, and that the fits are without; or empty.
    """

    verdict: str
    reason: str | None
    rows: int
    outliers: tuple[int, ...]
    rms: Rms
    steps: tuple[DiagnosedEffect, ...]
    unexplained: tuple[Unexplained, ...]
    ranking: tuple[Ranked, ...] = field(repr=False)
    fits: tuple[Fit, ...] = field(repr=False)
    correlation: Correlation | None = field(repr=False, default=None)
    notes: tuple[str, ...] = ()
    estimates: Mapping[str, Estimate] = field(default_factory=dict, repr=False)
    could_hide: tuple[Detectable, ...] = field(default=(), repr=False)
    indistinguishable_sets: tuple[SetAlias, ...] = ()
    log10_odds: float = 0.0
    wrong_bounds: str = ""
    geometry: WrongGeometry | None = field(repr=False, default=None)

    def __post_init__(self) -> None:
        for name in ("steps", "unexplained"):
            object.__setattr__(self, name, Records(getattr(self, name), _record))

    @property
    def base(self) -> Fit:
        """The fit of the model as it was."""
        return self.fits[0]

    @property
    def final(self) -> Fit:
        """The fit of the model with all effects that were found."""
        return self.fits[-1]

    @property
    def found(self) -> tuple[DiagnosedEffect | Unexplained, ...]:
        """Effects of the catalogue, then forms, in the order of adding."""
        return (*self.steps, *self.unexplained)

    @property
    def final_with_forms(self) -> Fit:
        """The fit with all effects and forms that were found."""
        return self.unexplained[-1].fit if self.unexplained else self.final

    @property
    def further_exclusions(self) -> tuple[SetAside, ...]:
        """The entries of ``set_aside`` that the machine file needs so that the outliers do not count."""
        there = self.base.machine.measured.set_aside
        return tuple(entry for entry in self.machine.measured.set_aside if entry not in there)

    @property
    def machine(self) -> Machine:
        """The machine with all effects and forms that were found, fitted values, and the outliers set aside."""
        return self.final_with_forms.excluding_outliers(EXCLUDED)

    @property
    def outlier_rows(self) -> list[int]:
        """The outliers as their table numbers them, with their copies; none where it is unknown or read in parts."""
        return self.final_with_forms.outlier_rows

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as ``rodgen diagnose --json`` prints it."""
        content: dict[str, Any] = {"verdict": self.verdict}
        if self.wrong_bounds:
            content["wrong_bounds"] = self.wrong_bounds
        if self.reason is not None:
            content["reason"] = self.reason
        content |= {
            "rows": self.rows,
            **self.base.observations.not_here,
            **plain(self, "odds outliers rms steps unexplained dependence=final_with_forms.dependence"),
        }
        if self.rms.before_held_out is not None:
            content["held_out_by"] = self.base.held_out().by
        if self.rms.not_held_out is not None:
            content["not_held_out"] = dict(self.rms.not_held_out)
        if on_sky := pointing(self.final_with_forms):
            content["pointing"] = on_sky.to_dict()
        if self.geometry is not None:
            content |= plain(self, "geometry")
        if self.further_exclusions:
            content |= plain(self, "exclude=further_exclusions")
        if self.indistinguishable_sets:
            content |= plain(self, "indistinguishable_sets")
        if self.verdict == "nothing_missing":
            content |= plain(self, "could_hide")
        return content

    @property
    def unseen(self) -> tuple[Effect, ...]:
        """Effects that these data could not show at all; on a mount none whose terms the model has in other parts.

        Where dimensions are estimated, none that is one of them.
        """
        sized = {
            one.effect.title for one in self.could_hide
        }  # with another value of what is searched it shows
        ranked = [r.effect for r in self.ranking if r.visible < COST.visible]
        if on_sky := pointing(self.final_with_forms):
            ranked = [e for e in ranked if not (e.terms and e.term_names <= on_sky.terms.keys())]
        there = frozenset() if self.geometry is None else GEOMETRY
        return tuple(e for e in ranked if not (e.title in sized or e.name in there))

    @property
    def open_questions(self) -> OpenQuestions:
        """What the data leave open, for a plan of measurements."""
        alternatives = [
            (step.effect, *(a.effect for a in step.indistinguishable_from if _is_one(a)))
            for step in self.steps
        ]
        alternatives = [each for each in alternatives if len(each) > 1]
        final, named = self.final_with_forms, {one.effect: None for one in self.found}
        for effect in () if alternatives else [e for step in self.steps for e in step.shared_by]:
            if effect not in named:
                final, named[effect] = final.extended([effect], {}), None
        play = [ranked for ranked in self.ranking if ranked.effect.name == "backlash"]
        sides, why = [r.effect for r in play if r.visible < COST.visible], ""
        if sides:
            why = f"Come from the other side, too: play of {joined([str(e.place) for e in sides])} shows only then."
        if self.correlation is not None and self.correlation.claimed and self.correlation.size("position"):
            sides = [r.effect for r in play]
            why = "Read at positions that were not read yet, from both sides: what their errors follow shows only then."
        return OpenQuestions(
            final=final,
            found=tuple(named),
            alternatives=tuple(alternatives),
            sides=tuple(sides),
            why=why,
        )

    def plan(self, n: int = 12) -> Plan:
        """Return what to measure next to settle what is open; see :func:`rodgen.calibration.plan.plan`."""
        from rodgen.calibration.plan import plan

        return plan(self, n)

    document = cast("Callable[..., Document]", method())
    plot = method()


def _is_one(alias: Alias) -> bool:
    """Return whether an alternative is one effect that a model may have."""
    return len(alias.effects) == 1 and not alias.effect.definition.own


def odds_of(log10_odds: float) -> float:
    """Return odds of which the logarithm is known, with three digits; at most 1e300."""
    return _rounded(10 ** min(log10_odds, 300.0))


def _rounded(odds: float) -> float:
    return float(f"{odds:.3g}")


def _estimates(parameters: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: {"value": e.value, "std": e.std, "unit": e.unit} for name, e in parameters.items()}


def _record(missing: DiagnosedEffect | Unexplained) -> dict[str, Any]:
    """Return the row of a table."""
    effect = missing.effect
    return {
        "effect": effect.name,
        "joint": effect.place,
        "parameters": "; ".join(f"{name} = {e.text}" for name, e in missing.parameters.items()),
        "odds": missing.odds,
        "rms": missing.rms,
        "rms_held_out": missing.rms_held_out,
        "meaning": effect.definition.meaning,
    }


def _named(effect: Effect) -> dict[str, Any]:
    return {"effect": effect.name, "joint": effect.place}
