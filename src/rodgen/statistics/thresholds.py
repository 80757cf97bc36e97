"""Every value that decides an answer of the calibration, each with its reason; one frozen policy for each question.

Each was chosen on machines with a known answer, by independent simulators: `make study` (`study/run.py`,
`study/plan.py`) measures the rates of false claims, of hits and of coverage, and tests named with a policy hold them.
Before and after a change of a value, run the study. Tolerances of an algorithm, which only keep rounding out of a
result, stand with that algorithm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

NEGLIGIBLE_WEIGHT = 1e-100
"""Weight of a reading that is left out of a fit. Not zero, so that its residual follows from the weighted one; its
square, 1e-200, vanishes in any sum with readings of weight 1."""
SMALLEST_P = 1e-300
"""Smaller probabilities are written as this: a double ends at 1e-308, and no reader distinguishes them."""


class CheckPolicy(NamedTuple):
    """Whether a machine file and its data can be right (tests/test_check.py, study/wrong_files.py)."""

    tails: float = 3.0
    """Degrees of freedom of the t distribution of errors: one reading in a hundred is farther out than six scales."""
    unseen: float = 1e-4
    """Part of the motion below which residuals are alike: wrong files do not show there."""
    usual_turn: float = 0.03
    """Standard deviation of an axis from the file, radians: two degrees, as of a machine that was drawn by hand. A
    correction costs the likelihood what it is improbable; a usual fit moves by far less, so that the cost only decides
    where the data leave a choice, such as half a turn."""
    usual_shift: float = 0.03
    """The same of a point on an axis, and of a length of a closed chain, relative to the machine's size."""
    usual_target: float = 0.05
    """The same of a target: where a ball or a reflector is glued is known less well."""
    usual_exchange: float = 0.2
    """The same relative to the distance to the next target, where that is less: else two names could be exchanged."""
    usual_effect: float = 0.02
    """What an estimated effect changes the readings by, relative to the motion: large for a machine, and so little that
    no scale of -2 can stand for a wrong sign."""
    largest_scale: float = 0.5
    """Scale error beyond which a number is no scale error: encoders are off by 1e-3 at most."""
    largest_turn: float = 0.35
    """Correction of an axis, radians (20 degrees), beyond which a file describes another machine."""
    largest_shift: float = 0.3
    """The same of a point or a length, relative to the machine's size."""
    largest_target: float = 1.0
    """The same of a target, which may be given roughly."""
    extent: float = 5.0
    """The machine's size is its extent, but no more than so many motions: its lengths may be in another unit."""
    far_out: float = 5.0
    """Scales beyond which a row does not count in the errors that are shown."""
    suspicious_correction: float = 0.3
    """Part of the largest correction from which on repairs are tried: six degrees of an axis."""
    suspicious_error: float = 0.01
    """Error relative to the motion from which on repairs are tried: robots that were never calibrated, a loose mount
    and the largest effects of `study/wrong_files.py` leave less."""
    impossible_error: float = 0.05
    """Error of most rows, relative to the motion, beyond which a file is wrong even if no repair is found."""
    impossible_correction: float = 2.0
    """Largest corrections beyond which it is: an axis 40 degrees off; what is merely unknown is estimated."""
    better: float = 3.0
    """Factor by which a repair must lower an error that is possible: the effects that a model misses do less."""
    decisive: float = 20.0
    """Logarithm of the likelihood that a repair must gain: chance gains about ln(1000) among a thousand repairs and
    pairs, and the likelihood of rows that are not independent exaggerates."""
    same: float = 6.0
    """Difference of the logarithm within which repairs are alike: the rest of a rough geometry, or of effects, makes as
    much."""
    beam: int = 5
    """Repairs that are tried together with a second one."""
    finalists: int = 16
    """Repairs whose fits are carried to their end, after a few steps of each."""
    fewest_rows: int = 60
    """Rows on which repairs are compared, and for each parameter ..."""
    rows_a_parameter: int = 4
    """... so many."""


class EvidencePolicy(NamedTuple):
    """How much evidence a diagnosis needs before it says anything."""

    fewest_residual_dof: int = 6
    """Readings beyond the parameters: with fewer an F test has no power."""
    fewest_poses: int = 4
    """Poses: with fewer every drift looks like an effect."""
    folds: int = 10
    """Blocks of poses for errors on poses left out, while effects are chosen: without a block a tenth is lost."""
    copies: float = 0.05
    """Share of the rows that may repeat others by chance where readings have few digits; more are taken for copies,
    ..."""
    copied_in_order: int = 5
    """... where so many in succession repeat others in the same order. Of readings of one component whose noise is as
    large as their last digit a quarter repeats an earlier one: five in succession do in one of a thousand places."""
    largest_wrong_part: float = 0.35
    """Largest share of rows that may be wrong, as misidentified stars are: a robust fit finds them while more than half
    of the rows agree. Where more look wrong, the model lacks something."""
    rounds: int = 5
    """Times at most that effects are looked for without the rows that look wrong with those found before."""
    other_mode: float = 0.5
    """Share of the rows nearer to another assembly mode from which on the nominal machine is in the wrong one."""
    same_position: float = 1e-3
    """Part of a joint's way within which positions are one: a command repeats, though an encoder reads a little off."""
    trimmed: float = 1e-3
    """Part of a joint's range below which its way from row to row is a trim, not a move, ..."""
    trims: float = 0.05
    """... and share of its ways that may be so short by chance, if positions are random."""
    positions_a_freedom: int = 3
    """Distinct positions of its joint that a wave of a searched period needs for each of its three freedoms: some wave
    goes through any five errors, and with replicates it does so with any probability."""
    most_refused: int = 8
    """Effects that full fits do not confirm, after each of which effects are selected anew."""
    changed_rows: float = 1e-3
    """Share of the rows that may change between outlier and not without a new selection of effects."""
    same_arm: float = 0.1
    """Relative change of the ratio of two noises without which effects are not selected anew: weights that are a tenth
    off cost a four-hundredth of what estimates know, ..."""
    balanced: int = 3
    """... and times at most that they are: the ratio is then as good as the effects that were found."""


class OutlierPolicy(NamedTuple):
    """Rows that are grossly wrong, before the model is known (tests/test_diagnose_space.py)."""

    fewest_rows: int = 8
    """Rows: the scale is their median size, which scatters by a third with eight rows of one reading, by a fifth with
    eight of three."""
    largest_part: float = 0.2
    """Largest share of rows: with all candidates in it a fit follows more; then the model with what was found tells."""
    readings_a_column: int = 4
    """Readings for each column of the robust fit at least: with more columns each row would be fitted by itself."""
    visible: float = 0.1
    """Part of a candidate's column that must remain outside of the model: a smaller rest is rounding, or noise."""
    common_columns: int = 120
    """Directions of the candidates that the robust fit has, whatever the residuals: with more it follows single
    readings, as with all 156 of a trunnion's candidates the first one, however wrong."""
    most_columns: int = 180
    """The same, at most, where the residuals are large along so many: for robots with 6 to 11 joints the 120 that
    candidates have most in common left two to ten times the variance of the noise, and good rows looked wrong; of those
    along which the residuals are largest 180 left at most twice as much, and more take long."""
    beyond_chance: float = 3.0
    """Standard deviations by which the residuals must exceed zero along such a direction: chance does in one of 370."""
    cut_off: float = 10.0
    """Scales (of the median) at which the residuals are cut off there. Without, a reading of a trunnion that was wrong
    by 100 scales was followed and not found; at 4, a robot's eccentricity lost so much that good rows looked wrong."""
    least_left: float = 0.05
    """Part of its variance that the fit leaves a row, at least: the residual of a row that the fit follows nearly whole
    would be magnified without limit."""
    suspicion: float = 0.8
    """Part of the cut: where the largest row of the unweighted fit is below it, no row is an outlier."""
    false_alarm: float = 0.01
    """Rate of data sets in which the largest good row is called wrong."""
    neighbours: float = 1e-3
    """Probability by chance of as many neighbours among wrong rows, below which they show an effect and are right."""
    rows_around: int = 2
    """Rows before and after, in the order of measuring, whose mean a row that looks wrong is compared with. If it is no
    outlier there, it lies on a smooth branch, ..."""
    branch: float = 0.7
    """... where it is also nearer to them than to the model by this factor: chance brings a row that is five standard
    deviations off so near to the mean of four good ones, of half a deviation, in one of a thousand cases."""


class VariancePolicy(NamedTuple):
    """What readings of a pose share and how a set-up wanders (tests/test_correlation.py)."""

    least_poses: int = 8
    """Poses: with fewer, readings are treated as independent."""
    most_poses: int = 300
    """Poses that the restricted likelihood is evaluated on; more change the variances by less than their errors."""
    most_targets: int = 100
    """Targets whose readings it is evaluated on, those read most often: the place of each is three fixed effects, time
    grows with their square, and a thousand degrees of freedom already give a standard deviation to 2 %."""
    stretches: int = 5
    """Number of stretches taken of more poses: neighbours show short correlation times, stretches long ones."""
    effect_p: float = 0.01
    """Probability, over all effects or pairs of them, below which an effect, or two, are fixed, whatever wanders."""
    likelihood_share: float = 2 / 3
    """Share of the likelihood ratio in the logarithm of that probability where something wanders, too; the rest is that
    of F with the variances estimated without the effect. The likelihood ratio alone claims slow effects in up to one of
    ten data sets with drift; F alone hardly finds them."""
    instead: float = 6.0
    """Increase of twice the log restricted likelihood, less one for each parameter and what the values tried gain, from
    which on an effect takes the place of what wanders: it is twenty times as likely. Drifts and shifts of a mount and a
    ballbar reached 13 to 22, random walks and day cycles of five machines 2 at most."""
    looks_like_effect: float = 0.025
    """And probability that a wander of that size looks so much more like the effect than like itself. A walk that
    varies by a reading's error looks like a drift, or like shifts of its runs: of walks on a telescope with 36 poses
    58 %, on a mount and a ballbar 22 % reached `instead` with shifts. Drifts of a mount and shifts of a ballbar that
    raise the error by half have 0.008 to 0.02, the shifts that a walk on the telescope looked like 0.2."""
    certain: float = 16.0
    """The same increase from which on that probability is not asked for: walks on those three reached 15 in 6, 2 and
    3 % of the cases."""
    draws: int = 400
    """Draws of a wander from which that probability is counted: ten of them."""
    most_effects: int = 6
    """Most effects that are taken as fixed, one after the other."""
    tried: int = 3
    """Effects that are compared with wander alone at each step; those that are alike count as one."""
    alike: float = 0.9
    """Share of a space that two effects have in common from which on they count as one, as with two periods of one."""
    gain: Mapping[str, float] = MappingProxyType({"pose": 4.0, "wander": 5.0})
    """Increase of twice the log restricted likelihood that chance exceeds in one of ten cases: an overlooked drift
    makes false claims, a superfluous one costs a little power."""
    claimed: float = 10.0
    """The same from which on the dependence is reported: chance exceeds it in less than one of a hundred cases. What
    gains less is allowed for in every test, as a precaution, but not claimed."""
    visible: float = 1e-3
    """Part of a direction of the candidates' columns that must remain outside of the others for a column of its own."""
    widest: float = 2.0
    """Standard error, in logarithms, of a size or a time that readings show nothing of."""
    uncertain: float = 2 / 3
    """Variance of the logarithm of a parameter's variance, at most: that of three degrees of freedom, with which a
    standard deviation is 1.7 times as large. With fewer it would have no end."""
    smallest: float = 0.03
    """Standard deviation, relative to that of a reading's independent error, below which a component is zero."""
    largest: float = 1e5
    """The same, at most: markers that are one body, whose pose was measured, share an error of a thousand times what
    their digits leave between them. With a lower bound what they do not scatter against each other makes the variance
    of a pose too small, by half for three points; beyond it, rounding decides (1e-5 squared leaves six digits)."""
    rise: float = 3e-4
    """Log restricted likelihood: where a step promises less, the search for its maximum ends."""
    longest: float = 5.0
    """Correlation time, in durations of a run, beyond which the wander is a random walk."""
    several_readings: float = 1.5
    """Mean number of readings of a pose from which on a design effect can be estimated."""
    design_effect: float = 1.3
    """Least design effect that is allowed for: a smaller one is chance."""


class SelectionPolicy(NamedTuple):
    """Which candidates together explain the residuals (tests/test_diagnose_space.py, tests/test_hidden_effects.py)."""

    family_wise: float = 0.01
    """Rate of false alarms over all candidates together."""
    suspected: float = 0.05
    """The same below which an effect is mentioned that is not beyond chance: no claim, but one of twenty data sets."""
    suspects: int = 4
    """Candidates of which that is asked, those that chance imitates least."""
    visible: float = 0.02
    """Part of a candidate's column, or combination of columns, that must remain outside of the model to be tested: with
    less an effect would have to be fifty times as large as what it shows."""
    weightless: float = 1e-3
    """Part of the machine's reach below which the lever arm of a weight only comes from the slight tilt of an upright
    axis, or from rounding: effects of the weight are not tested there."""
    noticed: float = 0.005
    """The error on poses left out must fall by this part: what lowers it less is not worth an effect."""
    imperfect: float = 0.03
    """Part of its size by which a real effect differs from its formula; a remainder at the same place that is smaller
    does not count as a second effect, and what chi-square gains by it does not tell two effects apart."""
    shrunk: float = 10.0
    """Usual sizes within which parameters that the data hardly determine are held when sizes are judged."""
    bent: float = 5e-3
    """Relative accuracy of columns: a large effect is not linear, and what its column leaves does not count as another
    effect."""
    alike: float = 0.005
    """Effects whose falls of chi-square differ by less than this part are alike: the simpler one is named."""
    parameter: float = 12.0
    """By this plus ln(rows) a parameter chi-square must differ for readings to tell effects, or an effect and a form,
    apart, and to call for a further weight: Schwarz's criterion, and a margin because there are many to choose from."""
    most_steps: int = 8
    """Most effects that are added."""
    rivals: int = 40
    """Candidates that are tried in exchange for one or two of the set."""
    pairs: int = 8
    """The same of pairs: those that promise most by their columns."""
    most_exchanged: int = 3
    """Most of the set that are exchanged at once."""
    same: float = 0.5
    """Share of what an effect explains that an alternative must explain to be named."""
    alternative_limits: float = 3.0
    """A full fit is made of an alternative whose columns come within so many limits of the effect, ..."""
    alternative_bent: float = 0.01
    """... or within this part of what is explained: columns of large effects are no better."""
    in_part: float = 0.5
    """Part of the effect that an alternative may lack to do the same; with more it explains the readings otherwise."""
    same_change: float = 0.1
    """The same to be said to do the same but for that part; with more it changes the readings in a similar way."""
    balanced: float = 13.8
    """Cost in chi-square, 2 ln(1000), of a weight that turns a joint upwards where the file says nothing of a
    counterbalance: few are balanced by more than the weight, and those who write the file would know."""
    impossible: float = 3.0
    """A sign is impossible from which an estimate is so many of its standard deviations away: chance does it in one of
    700 cases."""
    too_large: float = 2.0
    """The same of a size: hardly a machine has the largest, so that chance does it far less often than in one of 40."""
    unlikely: float = 9.2
    """Cost in chi-square, 2 ln(100), from which on an alternative that does only part of the same is not listed."""
    tie: float = 2.2
    """Cost in chi-square within which two explanations are as likely, a factor of three: odds before the data are known
    no better. Then the one is named that is likelier before the data ..."""
    clearly: float = 4.6
    """... by more than this, a factor of ten: more than a grade of the table of odds."""
    most_alternatives: int = 16
    """Alternatives of which full fits are made, ..."""
    most_pairs: int = 40
    """... and pairs of effects that are compared: hundreds of pairs of legs do nearly the same."""

    def parameter_cost(self, rows: int) -> float:
        """Return by how much chi-square must differ for each parameter, for readings to tell models apart."""
        return self.parameter + math.log(rows)


class UncataloguedPolicy(NamedTuple):
    """Whether something outside the catalogue acts (tests/test_unexplained.py)."""

    most_forms: int = 3
    """Most forms that are reported."""
    a_form: float = 16.0
    """What chance gains in chi-square from the choice among so many forms: 2 ln(number)."""
    rivals: int = 4
    """Sets of effects of which full fits are made before a form is believed."""


class FormPolicy(NamedTuple):
    """Which form describes what the catalogue does not explain (tests/test_unexplained.py)."""

    visible: float = 1e-6
    """Part of a column's sum of squares that must remain outside of the model: with less its size would be rounding."""
    noticeable: float = 0.01
    """Least part of the mean square on poses left out that a form must remove: half a percent of the error."""
    choices: float = 3.0
    """Factor of the number of tests for each searched value: between the values on the grid are others."""
    a_driver: int = 2
    """Parameters that a further driver counts as: there are many to choose from."""
    slight: float = 5.0
    """Variances of a reading within which sums of squares on poses left out are equal: two columns that are all but the
    same differ by less than chance, and by more than its error."""
    fewest_residual_dof: int = 4
    """Readings beyond the parameters that a search needs."""
    lost: float = 0.3
    """Variances of a reading that a fall may lose for the sake of fewer digits."""


class VerdictPolicy(NamedTuple):
    """What the findings amount to (tests/test_hidden_effects.py)."""

    rare: float = 0.01
    """Probability by chance of residuals, or of an effect's parameters, as large, below which they are real."""
    sharper: float = 100
    """How many times as probable by chance the estimates of an effect must be as its p for that to be explained, ..."""
    beyond_doubt: float = 1e-6
    """... and how probable: below, both say the same."""
    power: float = 0.95
    """Probability with which an effect of the stated size would have been found where nothing is missing."""
    uneven: float = 1.7
    """Ratio of the rms of residuals to that of normal ones of which as many are within their median, beyond which many
    are off: it is 1.4 of errors that fall off as an exponential, 1.6 at most where noise differs tenfold between rows,
    and 2 or more where half of the rows are misidentified stars."""
    longest: float = 10.0
    """Durations of the measurement that a time constant may be: with more an exponential is a straight line to a
    percent of its size."""
    shortest: float = 0.5
    """Times between two readings that it may be, at least: with less an exponential is over before the second, to
    14 %."""
    changed: float = 2.0
    """Times that on poses left out from which on the error on further measurements is explained: by chance it is larger
    by a fifth, and where these go beyond the others, by a half."""
    wander: float = 2.0
    """A set-up that wanders by more than so many times the noise may hide a missing effect."""
    independent_error: float = 1.3
    """Where the set-up wanders, the independent error of a reading may be so many times the stated noise."""
    unusual: float = 10.0
    """Usual sizes from which on the size of an effect is called rare: a Cauchy distribution has 6 % beyond that."""
    one_way: float = 0.9
    """Net over total travel from which on a joint moved one way: its slow effects look like a wandering set-up."""
    jump: float = 0.3
    """Share of the sum of squares that a jump of the set-up, or a displaced stretch, must explain to be named."""
    sudden: float = 1.5
    """How many times as much as a single jump or a smooth drift does a displaced stretch must explain."""
    together: float = 0.7
    """Share of the poses of a stretch that must be outliers for the stretch to be called displaced."""


class EffectTestPolicy(NamedTuple):
    """Whether an effect takes away more of the error than chance does (tests/test_ladder.py)."""

    significant: float = 0.001
    """Probability by chance below which an effect is real: the user may have tried thirty before."""
    searched_values: int = 200
    """Independent values of a searched parameter at least: no search tries many more that are unlike each other."""
    time_constants: int = 7
    """The same of a time constant: exponentials are much alike, and twelve of them amount to four to six tests."""
    poses_a_parameter: int = 20
    """Poses for each parameter from which on a pose's own leverage on its residuals does not matter."""


class WalkPolicy(NamedTuple):
    """Walks over which the test of a function of time is averaged (tests/test_unknown_walk.py)."""

    smallest: float = 0.05
    """Size of the least walk, the rms about its mean, in what a reading scatters by itself: of a smaller one nothing is
    seen in a trend of a thousand readings."""
    largest: float = 10.0
    """The same of the largest: between neighbours it is seen, and beyond it ..."""
    beyond: float = 5.0
    """... walks up to so many times the estimated size are tried."""
    sizes: int = 20
    """Their number: each is by a third larger than the one before, which is how well a walk of 36 poses is known."""


class LackOfFitPolicy(NamedTuple):
    """Whether the residuals are larger than the noise (tests/test_noise.py)."""

    rare: float = 0.01
    """Probability by chance of residuals as large as found, below which they exceed the noise."""
    improbable: float = 0.001
    """A lack of fit this improbable is mentioned with the verdict on an effect."""


class NoisePolicy(NamedTuple):
    """Whether two estimates of the noise contradict each other (tests/test_noise.py)."""

    chance: float = 0.005
    """Probability by chance of a figure as far off to one side, ..."""
    alike: float = 1.1
    """... which must also be off by more than this factor: finer differences do not matter."""
    one_body: float = 1e-4
    """Part of the residuals below which distances between targets hardly differ from pose to pose. Of targets that are
    read one by one they differ by what a reading is uncertain, and no model is ten thousand times worse than that."""


class RobustPolicy(NamedTuple):
    """Which rows a robust fit leaves out (tests/test_robust.py)."""

    false_alarm: float = 0.01
    """Probability that good data have a row that is called an outlier."""
    bad: float = 0.3
    """Share of bad rows that random sets are prepared for, ..."""
    miss: float = 0.001
    """... of which none is free of bad rows with this probability, ..."""
    most_sets: int = 100
    """... unless that takes more sets than this."""
    heavy_tails: float = 0.001
    """Probability of the kurtosis of normal residuals below which more rows may be wrong than one sees from the fit."""
    fewest_for_tails: int = 20
    """Residuals from which on their kurtosis has that probability."""


class GrossPolicy(NamedTuple):
    """Which readings are grossly wrong beyond any doubt (tests/test_gross_readings.py)."""

    factor: float = 3.0
    """Times the largest residual of the rows that agree. What the models of the examples miss, before a diagnosis,
    makes rows that are 1.4 times as far off at most."""
    suspicion: float = 1.5
    """Times the cut of a robust fit that one row must be off, from all rows: else nothing is looked for."""
    largest_part: float = 0.2
    """Largest share of rows: more are no slips."""
    fewest_rows: int = 10
    """Rows: among fewer a fit follows a wrong one."""
    spare: float = 0.5
    """Part of the other readings that are more than the parameters need: else a fit to these is close by itself."""
    named: int = 8
    """Readings whose errors a sentence gives."""


class DeterminacyPolicy(NamedTuple):
    """Which combinations of parameters the data determine (tests/test_determinacy.py)."""

    nothing: float = 1e-9
    """A combination whose effect is below this part of the largest one, all parameters scaled alike, changes nothing:
    rounding in the Jacobian of a gauge direction leaves about 1e-14, a combination worth estimating at least 1e-7."""
    weak: float = 1e-3
    """A combination below this part is hardly determined: its parameters have a standard deviation a thousand times as
    large as if the others were known."""
    largest_turn: float = 0.05
    """Largest deviation of an axis from its file, radians (3 degrees); a point or a target may move by as large a part
    of the machine's size. Every file is better than that, and beyond it readings bend along a direction by more than
    the noise: no standard deviation holds."""
    largest_effect: float = 0.005
    """The same of an effect, in radians, or as a part of the machine's size, of a parameter or of what it does to
    readings: gears and arms that give way by 0.3 degrees are worn out, or of plastic. Of a user's own formula nothing
    is known."""
    says_less: float = 0.5
    """Part of the variance of a prior that readings must leave along its direction for the prior to count: they leave
    more than all of it where the prior is needed, and none where a choice of coordinates left none."""
    part: float = 0.3
    """A parameter is named with a direction along which the file holds a fit that has this part of it, measured in the
    largest deviations of a machine from its file."""
    rests: float = 5e-3
    """A parameter that has a greater part in a direction that is not determined is not determined itself."""
    correlated: float = 0.95
    """Parameters whose correlation exceeds this are named: they are hardly distinguished."""
    hardly: float = 20.0
    """A parameter of an effect is hardly determined whose standard deviation is so many times that of another, ..."""
    certain: float = 4.0
    """... and whose value is within so many of its own: other parameters make up for it."""


class ComparisonPolicy(NamedTuple):
    """What a comparison says of residuals (tests/test_compare.py); all false claims together are below 1 %."""

    dependence: float = 0.004
    """Probability of any claim of a dependence where there is none."""
    region: float = 0.001
    """The same of a region where the model is worse."""
    in_time: float = 0.001
    """The same of a drift, and of a correlation in time; each."""
    uneven: float = 0.001
    """The same of uneven scatter."""
    tails: float = 0.0005
    """The same of heavy tails, and of a residual that is too far out; each."""
    explained: float = 0.01
    """Part of a component's variance that a dependence explains at least to be mentioned."""
    taken_out: float = 0.05
    """A driver that was found is taken out of every component with a p-value below this."""
    suspected: float = 0.05
    """P-value below which a correlation in time is allowed for: far above the one at which it is claimed."""
    nearly_as_much: float = 0.93
    """Of drivers that explain this part of what the best one does, the first is named: a joint before a place."""
    half: float = 0.5
    """A pair waits for one of its two that explains this part of it alone."""
    visible: float = 0.02
    """Columns of which the fit leaves less than this part are not tested: there the residuals show nothing."""
    least_dof: float = 6.0
    """With fewer denominator degrees of freedom every p-value is a guess about the shape of the errors."""
    worse: float = 1.15
    """Ratio of the rms in a region to that of all rows from which it is mentioned."""
    as_bad: float = 0.93
    """A joint's region is named before that of a place whose t is larger by less than this factor."""


class PlanPolicy(NamedTuple):
    """What a plan of measurements counts on (tests/test_plan.py); what refutes an effect is `SelectionPolicy`'s."""

    doubt: float = 0.05
    """Probability that a plan may leave a wrong effect that cannot be distinguished from the true one: what is meant by
    confidence as a rule. Half of it would take a sixth more readings."""
    margin: float = 1.8
    """Quantile of the normal distribution for that probability, with one wrong effect (1.64) or two (1.96)."""
    hopeless: float = 0.5
    """Probability below which readings rather fail to tell effects apart: none are spent on these alone."""
    idle: float = 0.01
    """More readings are not worthwhile that raise the probability of telling effects apart by less."""
    unlikely: float = 0.003
    """No readings are planned for the case that an effect is there which is less probable than this, as what is three
    standard deviations away: alternatives with many parameters, or rare ones, that imitate the others."""
    sharper: float = 0.5
    """Part to which a standard deviation must fall for readings to be said to determine the parameter."""
    noticed: float = 0.95
    """Readings that lower every standard deviation to no less than this part sharpen nothing: how large a standard
    deviation is, is known to a twentieth from 200 readings."""
    largest_turn: float = 0.1
    """Angle of an effect, in radians, that no machine has: a loose mount is off by a hundredth of it, and a fit that
    ends there has turned an axis round."""
    fewest_residual_dof: int = 10
    """Degrees of freedom from which residuals larger than the stated noise replace it: with fewer, chance alone makes
    their mean square half as large again (its relative standard deviation is the square root of 2/10)."""
    most_dependent: float = 30.0
    """Dependent readings raise the variance of a mean by this factor at most; beyond, a fit went elsewhere."""


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
    confirmed: int = 2
    """Readings after which an alarm must still stand: no single bad reading is a change."""
    levels: int = 12
    """Levels of times at which a change may have begun, ..."""
    kept: int = 4
    """... of which each keeps so many: the oldest began 8192 blocks ago. In so many readings a change of a tenth of the
    noise is seen, and none of a thirtieth matters."""
    looks: int = 8
    """Times that a level is looked at in one of its steps: a change is seen later by an eighth at most."""
    exact: float = 0.05
    """Part of all readings up to which those since a change leave what was known before it as it is; to neglect that
    makes the sum smaller, by as little."""
    sizes: tuple[float, ...] = (0.1, 0.5, 2.5)
    """Standard deviations of a change, as rms per reading, in units of the noise: in steps of five, as each is good for
    changes of half and of twice as much. Three cost log 3."""
    unseen: float = 1.0
    """Standard deviation of what an effect that the model lacks does to the reference readings, in units of their
    residuals: they show what is there, and it is no change."""
    unknown: float = 1e5
    """The same of parameters of the model, of which nothing but the reference readings says anything."""
    noise: float = 0.1
    """Part of the false alarms that a change of the noise may have."""
    bins: tuple[float, ...] = (0.5, 0.8, 0.95, 0.99)
    """Parts of normal readings that are nearer than the bounds between which they are counted."""
    rounds: int = 5
    """Times that the reference readings are clipped anew."""
    recent: int = 256
    """Readings that are kept as they are: a change that is seen only after more of them is so small that none is
    clipped."""
    settled: int = 32
    """Blocks after an alarm until a change is named for good, and things are taken for what they are since."""
    wrong: float = 10.0
    """Standard deviations beyond which a reading says no more of a change than that it is wrong."""
    large: tuple[float, ...] = (0.1, 0.5, 2.5, 12.5, 62.5, 312.5)
    """The same as `sizes` where readings are as they are."""
    together: int = 6
    """Alternatives that may change together, at most, as where a machine was set up anew, ..."""
    further: float = 5.0
    """... each of which must make the readings e^5 times as likely, the choice among hundred of them counted."""
    waited: int = 10
    """Blocks after which a reading that was far off is an outlier: a change as large would have raised an alarm."""
    stuck: float = 6.0
    """Standard deviations by which what is predicted must move while a reading repeats its digits, ..."""
    stuck_times: int = 3
    """... and how often, one after the other: noise makes up for it once in 40,000, three times in 1e13."""
    fewest: float = 20.0
    """Degrees of freedom that the reference must leave: with fewer its noise is hardly known to a fifth."""
    beyond: float = 0.1
    """Part of the range that the reference covers, of a coordinate say, beyond which the model may be wrong."""
    outside: float = 0.1
    """Probability that a change began outside of the readings that are named."""
    likely: float = 0.05
    """Probability from which on an alternative is named, and its ratio to the best one by the readings alone: how
    common effects are is known to an order of magnitude only, and hides nothing that few readings show as well."""

    def clip(self, components: int) -> float:
        """Return the length of a reading's error, in standard deviations, beyond which it is clipped."""
        from scipy import special

        return math.sqrt(float(special.chdtri(components, self.clipped)))


CHECK = CheckPolicy()
EVIDENCE = EvidencePolicy()
OUTLIERS = OutlierPolicy()
VARIANCES = VariancePolicy()
SELECTION = SelectionPolicy()
UNCATALOGUED = UncataloguedPolicy()
FLEET = FleetPolicy()
FORMS = FormPolicy()
VERDICT = VerdictPolicy()
WALK = WalkPolicy()
EFFECT_TEST = EffectTestPolicy()
LACK_OF_FIT = LackOfFitPolicy()
NOISE = NoisePolicy()
ROBUST = RobustPolicy()
GROSS = GrossPolicy()
DETERMINACY = DeterminacyPolicy()
COMPARISON = ComparisonPolicy()
PLAN = PlanPolicy()
WATCH = WatchPolicy()
