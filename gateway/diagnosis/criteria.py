"""Thresholds of the inference, each with its reason."""

from typing import Final

NAMED: Final = 0.99
"""Probability from which an effect is identified: at most one name in a hundred is wrong if probabilities hold."""

LISTED: Final = 0.1
"""Probability from which an effect that is not identified is listed: twice its prior, which it keeps where the data say
nothing about it."""

SUPPORTED: Final = 0.05
"""Probability from which the sets with an effect widen the errors of numbers: below, the prior alone is as large."""

OPEN_RATIO: Final = 2.0
"""Ratio of an error to that without an effect whose presence is open, or without another optimum, from which a note
holds it responsible for the error."""

PRIOR_ODDS: Final = 0.05 / 0.95
"""Odds of an effect before the data: two of forty effects on average."""

EXPECTED_ODDS: Final = 1.0
"""Odds of an effect that is the error of something merely assumed, such as a mounting offset that nothing states:
nothing speaks for its absence."""

STAND_IN_ODDS: Final = 0.01
"""Odds that something outside the catalogue looks like an effect at impossible values: below those of any effect."""

FAR_LESS: Final = 0.5
"""Share of the power that a set leaves beyond noise: a set of no more effects that leaves less explains the data
better, whatever the evidence of their discrepancies."""

LEAVES_THE_SAME: Final = 0.1
"""Share of what a set leaves of the wheel's plane or of the lateral axis, and of the noise there, by which another may
leave more and still not count as worse: fits move by that much for the sake of the other part."""

TEMPERED: Final = 2.0
"""Power of what a set leaves over that of the noise from which an effect must reduce it to count, and ratio of their
rms from which a note says that the evidence was divided by it."""

NUMBERS_APART: Final = 0.1
"""Logarithm by which a number must differ between recordings of one state, besides three errors, where much is left
unexplained: effects that are not modelled move numbers of one tire by some percent from speed to speed."""

NO_RING: Final = 0.5
"""Share of the signal's rms about its mean that a set may leave of it: beyond, what is left is as large as what the
ring explains, and no number is that of a ring."""

LENGTHS_RAD: Final = (0.03, 0.12, 0.4)
"""Correlation lengths of the discrepancy: a tread block, a contact edge, the belt's lowest free shapes."""

BLOW_RAD: Final = 0.01
"""Correlation length within a place of a discrepancy that stands for blows: shorter than the highest order's wave."""

BANDS_FROM: Final = (40, 60, 85)
"""Orders from which a discrepancy may be concentrated in a band, up to the next of them or to the last: waves shorter
than its shortest correlation length."""

BURST_WIDTHS_RAD: Final = (0.1, 0.3)
"""Widths of the places at which a discrepancy may be concentrated: a splice or a stone, and what rings there."""

CONCENTRATED_SHARE: Final = 0.2
"""Share of the residual's power beyond noise that a single order or place must hold for the discrepancy to be
concentrated there: of a residual that is spread out it is a part like any other."""

MOST_CONCENTRATED: Final = 4
"""Most orders, bands and places at which a discrepancy is concentrated: each doubles the work of a set."""

NEAR_RAD: Final = 0.15
"""Angle beyond the contact edge up to which a discrepancy counts as near the contact: the belt's bending layers."""

FADE_RAD: Final = 0.3
"""Angle over which the window near the contact ends."""

OWN_SHARE: Final = 0.1
"""Share of the discrepancy's power that each recording has for itself: a third of its size, between the laws of growth
with speed that it has."""

START_SHARE: Final = 2e-5
"""Least amplitude of the discrepancy at the start, as a share of R omega^2: the equations' own errors."""

LEAST_SHARE: Final = 3e-6
"""Least amplitude, likewise: the computation's own error."""

SPEEDS_APART: Final = 1.1
"""Ratio of speeds from which a constant discrepancy is distinguished from one in proportion to omega^2."""

LOOKED_AT: Final = 6.0
"""Decrease of the cost that a candidate must promise to be fitted: below, prior odds and Occam factor outweigh it."""

WITHIN: Final = 6.0
"""Difference of log evidence from the best set up to which a set is fitted: beyond, its weight is below 0.3 %."""

SMALLER_DISCREPANCY: Final = 0.04
"""Share of the discrepancy's power under which candidates are proposed once more where much is unexplained: a true
effect that the discrepancy stands for promises little under all of it."""

OPTIMA_TRIED: Final = 4
"""Starts of an effect far from its optimum from which a set is fitted once more: two or three lead to the same."""

OPTIMUM_STEPS: Final = 15
"""Most steps of such a fit: from a trial that was followed, some ten are enough."""

BRANCHES: Final = 2
"""Chains of proposals: from the best and from the second-best first effect."""

REFITTED: Final = 3
"""Candidates fitted at each step of a chain, best promise first."""

RIVALS: Final = 6
"""Candidates fitted beside the best set or in place of one of its effects: up to three have the same waveform."""

PROMISE_SHARE: Final = 0.3
"""Share of the best promise below which a candidate of a chain is not fitted: linear promises are right to a third."""

STALLED: Final = 3
"""Sets of a chain in a row without more evidence than those before, after which it ends: where much is left and no
candidate fits, each addition takes longer and explains less. Two effects that need each other are two sets. A chain
all sets of which are worse than the best one by `WORTH_WORK` ends at the first."""

WORTH_A_SCAN: Final = 0.05
"""Power left beyond noise, over that of the noise, below which changes at one place and laws are not looked for."""

MOST_EFFECTS: Final = 8
"""Effects of one set: more were never needed by a recording."""

BEYOND_BOUND: Final = 1.0
"""Standard errors by which a value may lie outside its physical range; there Laplace's approximation ends."""

EXPLAINED_SHARE: Final = 0.02
"""A candidate of a chain must remove this share of the misfit beyond noise: the true one removes a large part."""

WORTH_WORK: Final = 25.0
"""Difference of log evidence from the best set, after the first step, up to which a set is worked out: later steps gain
up to some ten."""

WORTH_GROWTH: Final = 100.0
"""Difference of log evidence from the best set up to which a set without one of its effects is tried with another one:
a second effect gained up to 30 where two together were the better explanation."""

WORTH_CLIMBING: Final = 1.0
"""Log evidence, as it counts where much is left, by which a set must exceed those whose neighbours are known for its
own to be sought: less changes no verdict."""

SCANNED_GROUPS: Final = 4
"""Groups of revolutions in which candidates are tried; evidence is always that of all groups."""

MOST_SCANNED: Final = 6
"""Most groups of revolutions in which candidates are tried, those of the most different conditions."""

RIVAL_SHARE: Final = 0.3
"""Share of an effect's promise that another must have promised to be tried in its place."""

AT_NOISE: Final = 1.5
"""Misfit per coefficient at which a chain leaves nothing to find: its rivals are found by exchange."""

DENSITY_ERROR: Final = 0.1
"""Relative error of an effect's spectrum, quadrature or envelope: its equation is an idealisation."""

STRANGE_BINS: Final = 0.01
"""Share of frequencies at which a spectrum contains something unknown, of any size: a few lines or a narrow band."""

FREE_SIZE: Final = 1.0
"""Standard deviation of ln of a strange band's size on each axis of each group: it has no law, to a factor of three."""

SURPLUS: Final = 10.0
"""Power over density beyond which a bin counts no more in a linear trial: a line does not choose where a band lies."""

EDGE_SPREAD: Final = 0.3
"""Standard deviation of ln of contact-edge jitter between recordings: load and contact length change it by a third."""

EDGE_SHAPE: Final = 0.25
"""Share of the scatter near the contact edges that moving them back may leave: more is scatter of another shape."""

EDGE_SIGMAS: Final = 3.0
"""Standard errors by which a recording's mean edge angles may differ from those of all contacts."""

RARE: Final = 5.6
"""Standard deviations of a normal variate beyond which scatter is listed as unexplained: noise reaches it once in 1e8,
and some thousand places are looked at."""

TURNS_ALIKE: Final = 0.5
"""Ratio of the power of successive differences to that of deviations below which turns are alike: 1 where each has
another waveform, less than this where most of the deviation changes slowly."""

SIGMAS_LISTED: Final = 3.0
"""Standard errors above which the size of something listed is taken as known."""

AT_NOTHING: Final = 9.0
"""Chi-square of an effect's sizes below which the exact ring does not confirm it: three standard errors."""

FITS_AS_WELL: Final = 1.5
"""Ratio of the misfit to that of noise, or of the series, up to which the exact ring judges effects of the series."""

EXPLAINED_TO: Final = 0.2
"""Share of an effect's density within which a remainder is not listed: two of its errors (`DENSITY_ERROR`)."""

FILTER_TO: Final = 0.3
"""Share of the noise that a low-pass removes within which a remainder is not listed: its form is simplified."""

SIDEBANDS: Final = 0.03
"""Share of an effect's density that its sidebands at multiples of the wheel's frequency reach: the belt turns."""

BESIDE_A_LINE: Final = 0.15
"""Share of a strong line below which parts beside it are its sidebands, left by resampling each revolution to time."""

OVER_SCATTER: Final = 4.0
"""Ratio of a change's power to that of scatter from which it is listed: a steady ramp counts in that scatter too, so
that about five revolutions a block are needed."""

RARE_CHANGE: Final = 1e-8
"""Probability that scatter alone reaches a change in one band of one group."""

SIZE_SHARE: Final = 0.03
"""Share of a size by which an equation may err from recording to recording."""

CHANGE_OF_SIGNAL: Final = 3e-3
"""Share of the signal (rms) below which a change belongs to the signal's own drift."""

CHANGE_OF_RESIDUAL: Final = 0.1
"""Share of the mean residual (rms) below which a change belongs to that residual."""

CHANGE_OF_LARGEST: Final = 0.1
"""Share of the largest change of any axis below which a change is not listed."""

DETERMINED: Final = 0.3
"""Largest relative standard error of a number that is determined."""
