"""Every value that decides an answer of the calibration, each with its reason; one frozen policy for each question.

Values are argued, not tuned: from physics, rounding, or a convention of statistics. `make study` (`study/run.py`,
`study/plan.py`) reports the rates of false claims, of hits and of coverage on machines with a known answer, by two
independent simulators, and names the one on which constants were chosen. Numbers of an algorithm, such as steps of a
grid or how many solutions are tried, stand with that algorithm.
"""

from __future__ import annotations

import math
from typing import NamedTuple

NEGLIGIBLE_WEIGHT = 1e-100
"""Weight of a reading that is left out of a fit. Not zero, so that its residual follows from the weighted one; its
square, 1e-200, vanishes in any sum with readings of weight 1."""
SMALLEST_P = 1e-300
"""Smaller probabilities are written as this: a double ends at 1e-308, and no reader distinguishes them."""


class CostPolicy(NamedTuple):
    """What a set of effects costs, in units of chi-square: -2 ln of its probability (calibration/evidence.py)."""

    something: float = 2 * math.log(100)
    """Nothing is missing unless the best set is a hundred times as probable as none: beyond the 20 that are called
    strong evidence (Kass and Raftery 1995), as a wrong claim does more harm than a late one."""
    needed: float = 2 * math.log(20)
    """An effect is named where the set is twenty times less probable without it: strong evidence."""
    tied: float = 2 * math.log(100)
    """Others are named with it until they are a hundred times less probable."""
    alike: float = 2 * math.log(3)
    """Sets within a factor of three are equally probable: so far apart are the odds in the table of effects."""
    impossible: float = math.log(1000)
    """Logarithm of the odds against a sign that physics excludes, or a size that no machine exceeds: the file may be
    wrong, or the machine rare, in one of a thousand."""
    no_scale: float = 0.5
    """Scale error beyond which a number is no scale error, but takes the reading away."""
    certain: float = 2.0
    """Standard deviations by which a size must exceed the largest, or a sign be wrong, to be called so."""
    bent: float = 0.016
    """Error of a formula, relative to what it explains, as noise: a straight guide, a round gear and a beam of one
    section hold to a percent or two."""
    shared: float = 2.0
    """Factor on the uncertainty of a size from which on the same effect elsewhere is named, too: how much of it is
    where is then not known, as stated standard deviations say."""
    imperfect: float = 0.03
    """Part of an effect that may look like another one at the same place: nature's curve differs from the formula by
    some percent."""
    visible: float = 0.02
    """Part of a column that must remain beyond what the fitted parameters imitate: they are imperfect, too."""
    most: int = 12
    """Effects of a set: with more the file describes another machine."""


class CheckPolicy(NamedTuple):
    """Whether a machine file and its data can be right (tests/test_check.py, study/wrong_files.py)."""

    usual_effect: float = 0.02
    """What an estimated effect changes the readings by, relative to the motion: large for a machine, and so little that
    no scale of -2 can stand for a wrong sign."""
    imperfect: float = 0.01
    """Error relative to the motion up to which nothing is tried: robots that were never calibrated, a loose mount
    and the largest effects of `study/wrong_files.py` leave less."""
    impossible_error: float = 0.05
    """Error of most rows, relative to the motion, beyond which a file is wrong even if no repair is found."""
    impossible_correction: float = 2.0
    """Largest corrections beyond which it is: an axis 40 degrees off; what is merely unknown is estimated."""
    better: float = 3.0
    """Factor by which a repair must lower an error that is possible: the effects that a model misses do less."""
    decisive: float = 40.0
    """-2 ln of the odds at which a repair is named: chance gains 2 ln 1000 among a thousand repairs and pairs, and the
    probability of rows that are not independent exaggerates."""
    equal: float = 12.0
    """-2 ln of the odds within which repairs are equally probable: the rest of a rough geometry, or of effects, makes
    as much."""
    chance: float = 1e-3
    """Probability that corrections of a right file are larger than usual ones, and of a row that is not counted in the
    errors that are shown."""


class EvidencePolicy(NamedTuple):
    """How much evidence a diagnosis needs before it says anything."""

    fewest_residual_dof: int = 6
    """Readings beyond the parameters: with fewer the noise is hardly known to a third."""
    fewest_poses: int = 4
    """Poses: with fewer every drift looks like an effect."""
    same_position: float = 1e-3
    """Part of a joint's way within which positions are one: a command repeats, though an encoder reads a little off."""
    positions_a_freedom: int = 3
    """Distinct positions of its joint that a wave of a searched period needs for each of its three freedoms: some wave
    goes through any five errors, and with replicates it does so with any probability."""


class VariancePolicy(NamedTuple):
    """What readings of a pose share and how a set-up wanders (tests/test_correlation.py)."""

    claimed: float = 2 * math.log(20)
    """Cost by which the dependence is cheaper than independent readings from which on it is reported: it is then twenty
    times as probable. What gains less is allowed for in every test, as a precaution, but not claimed."""


class SelectionPolicy(NamedTuple):
    """Which parameters, and which weights of parts, a fit counts on (tests/test_hidden_effects.py)."""

    weightless: float = 1e-3
    """Part of the machine's reach below which the lever arm of a weight only comes from the slight tilt of an upright
    axis, or from rounding: effects of the weight are not tested there."""
    parameter: float = 12.0
    """By this plus ln(rows) a parameter chi-square must differ for readings to tell effects, or an effect and a form,
    apart, and to call for a further weight: Schwarz's criterion, and a margin because there are many to choose from."""
    impossible: float = 3.0
    """A sign is impossible from which an estimate is so many of its standard deviations away: chance does it in one of
    700 cases."""

    def parameter_cost(self, rows: int) -> float:
        """Return by how much chi-square must differ for each parameter, for readings to tell models apart."""
        return self.parameter + math.log(rows)


class VerdictPolicy(NamedTuple):
    """What the findings amount to (tests/test_hidden_effects.py)."""

    zero: float = 0.05
    """Probability by chance of an effect's parameters, in the full fit, above which they are zero within their
    uncertainty: two standard deviations."""
    power: float = 0.95
    """Probability with which an effect of the stated size would have been found where nothing is missing."""
    uneven: float = 1.7
    """Ratio of the rms of residuals to that of normal ones of which as many are within their median, beyond which many
    are off: it is 1.4 of errors that fall off as an exponential, 1.6 at most where noise differs tenfold between rows,
    and 2 or more where half of the rows are misidentified stars."""
    wander: float = 2.0
    """A set-up that wanders by more than so many times the noise may hide a missing effect."""
    independent_error: float = 1.3
    """Where the set-up wanders, the independent error of a reading may be so many times the stated noise."""
    unusual: float = 10.0
    """Usual sizes from which on the size of an effect is called rare: a Cauchy distribution has 6 % beyond that."""


class LackOfFitPolicy(NamedTuple):
    """Whether the residuals are larger than the noise (tests/test_noise.py)."""

    rare: float = 0.01
    """Probability by chance of residuals as large as found, below which they exceed the noise."""
    improbable: float = 0.001
    """A lack of fit this improbable is mentioned with the verdict on an effect."""


class RobustPolicy(NamedTuple):
    """Which pairs a robust fit of an axis leaves out (tests/test_axis_fit.py)."""

    false_alarm: float = 0.01
    """Probability that good data have a row that is called an outlier."""


class DeterminacyPolicy(NamedTuple):
    """Which combinations of parameters the data determine (tests/test_determinacy.py)."""

    nothing: float = 1e-9
    """A combination whose effect is below this part of the largest one, all parameters scaled alike, changes nothing:
    rounding in the Jacobian of a gauge direction leaves about 1e-14, a combination worth estimating at least 1e-7."""
    rests: float = 5e-3
    """A parameter that has a greater part in a direction that is not determined is not determined itself."""


class PlanPolicy(NamedTuple):
    """What a plan of measurements counts on (tests/test_plan.py); what refutes an effect is `SelectionPolicy`'s."""

    doubt: float = 0.05
    """Probability that a plan may leave a wrong effect that cannot be distinguished from the true one: what is meant by
    confidence as a rule. Half of it would take a sixth more readings."""
    margin: float = 1.8
    """Quantile of the normal distribution for that probability, with one wrong effect (1.64) or two (1.96)."""


class FleetPolicy(NamedTuple):
    """What is said of many machines together (tests/test_fleet.py)."""

    fewest: int = 8
    """Machines of one kind from which on their distribution is estimated: of five twice as many machines are called odd
    as should be (simulated), because they hardly show how they differ."""
    false_discoveries: float = 0.05
    """Part of the machines that are called odd, or to drift, of which this is wrong: such a machine is looked at."""
    most_odd: float = 0.25
    """Part of the machines that may be odd in one parameter: beyond, the others are no population."""
    common: float = 0.5
    """Part of the machines in which an effect is found, or may be there, from which on it belongs to their design."""
    nights: float = 365.0
    """Nights of a year, for the rate of false alarms."""
    false_alarms: float = 1.0
    """False alarms of a whole fleet in a year, unless a user asks for another rate: each costs a visit."""


class WatchPolicy(NamedTuple):
    """What a watch of new readings counts as a change (tests/test_change_detector.py, tests/test_watch.py)."""

    clipped: float = 0.003
    """Part of good readings that are clipped: with fewer a bad one counts more, with more a good one counts less."""
    at_once: float = 0.01
    """Part of the time between false alarms that a change between the reference and the first new reading stands for:
    there is more time there than between two readings."""
    rounds: int = 5
    """Times that the reference readings are clipped anew."""
    fewest: float = 20.0
    """Degrees of freedom that the reference must leave: with fewer its noise is hardly known to a fifth."""
    outside: float = 0.1
    """Probability that a change began outside of the readings that are named."""
    likely: float = 0.05
    """Probability from which on an alternative is named, and its ratio to the best one by the readings alone: how
    common effects are is known to an order of magnitude only, and hides nothing that few readings show as well."""

    def clip(self, components: int) -> float:
        """Return the length of a reading's error, in standard deviations, beyond which it is clipped."""
        from scipy import special

        return math.sqrt(float(special.chdtri(components, self.clipped)))


COST = CostPolicy()
CHECK = CheckPolicy()
EVIDENCE = EvidencePolicy()
VARIANCES = VariancePolicy()
SELECTION = SelectionPolicy()
FLEET = FleetPolicy()
VERDICT = VerdictPolicy()
LACK_OF_FIT = LackOfFitPolicy()
ROBUST = RobustPolicy()
DETERMINACY = DeterminacyPolicy()
PLAN = PlanPolicy()
WATCH = WatchPolicy()
