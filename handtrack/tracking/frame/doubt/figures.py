"""What tracked hands of other people say about doubt: `python -m tests.experiments.honesty.confidence` fits masks' numbers, signs and parts.

None is of one recording. How they are fitted: docs/explanation/uncertainty.md.
"""

from __future__ import annotations

from dataclasses import dataclass

USUAL_PER_VIEW = 15.0
"""energy a view of what was seen at which a model fits about as well as its noise says: half a hand's outline off by one sigma"""
LEAST_MISFIT, MOST_MISFIT = 0.3, 2.0
"""exact masks of the very model have 0.4 to 0.5, other hands' 1.1 to 2.1; ragged ones 3, of which no joint is the worse"""


@dataclass(frozen=True)
class Seen:
    """What is wrong with joints that one kind of evidence found, at a misfit of 1."""

    noise: float
    """factor on standard deviations"""
    noise_by_misfit: float
    """its exponent"""
    flesh_mm: float
    """how far another hand's joints lie beside the model's, constant offsets taken out [mm of a mean adult's hand]"""
    closed_mm: float
    """how much further the tip of a finger that is closed, whose flesh hides how far each joint bends: from its base it grows"""
    palm_mm: float
    """how much further all of a closed hand, whose knuckles and thumb flesh pushes about"""
    flesh_by_misfit: float
    """exponent of the misfit in all three"""


MASKS = Seen(0.77, 0.0, 0.56, 9.6, 0.99, 0.0)
"""how badly masks fit tells nothing of joints: exponents of 0.26 and 0.41 bring 0.03 of a log-likelihood of 17.8 a frame"""
CLOUD = Seen(0.7, 0.3, 1.4, 1.45, 0.56, 0.7)
"""a cloud's covariance has the hand's own shape in it already: `cloud.sigma_mm` for each patch"""
BODY = Seen(1.7, 0.0, 8.0, 0.0, 0.0, 0.0)
"""by joints that a detector sees, which are a skeleton's of its own: `handtrack bench honesty_bodies`, one to three cameras"""

MISSED = 5.0
"""what a wrong frame costs that nobody looks at, where a look costs 1: a look pays above a probability of 1 / MISSED. The least whole
number by which four of five wrong frames of `tune` are named"""
ALWAYS = -4.67
SIGNS = {"curled": 2.39, "moved": 0.71, "open": 0.84}
"""logarithm of the odds of a gross error: ALWAYS where no sign tells of one, and what each adds times its size; none subtracts"""
MOVED_UNKNOWN = 0.6
"""the sign `moved` of a live frame, which the frames after have yet to move: its mean over frames of that half"""
PART = (-3.46, 2.17)
"""logarithm of the odds that a part is 10 mm off: always, and times the logarithm of its least sure joint's stated standard deviation in
units of 3 mm. How far later frames moved the part, or all of it, adds nothing"""
