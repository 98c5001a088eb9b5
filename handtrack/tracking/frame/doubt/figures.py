"""What tracked hands of other people say about doubt: numbers fitted to `handtrack bench honesty`'s recordings, its half `tune`.

None is of one recording. How they are fitted: docs/derivations/honest_uncertainty.md.
"""

from __future__ import annotations

from dataclasses import dataclass

USUAL_PER_VIEW = 15.0
"""energy a view of what was seen at which a model fits about as well as its noise says: half a hand's outline off by one sigma"""
LEAST_MISFIT, MOST_MISFIT = 0.3, 3.0
"""exact masks of the very model have 0.4 to 0.5, other hands' 1.1 to 2.1, ragged ones 3; beyond, it is no noise"""


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
    """how much further in a finger that is closed, whose flesh hides its joints"""
    flesh_by_misfit: float
    """exponent of the misfit in both"""


MASKS = Seen(0.55, 1.15, 0.25, 5.0, 1.45)
CLOUD = Seen(0.85, 0.3, 1.2, 1.8, 0.7)
"""a cloud's covariance has the hand's own shape in it already: `cloud.sigma_mm` for each patch"""

NEEDLESS_LOOK = 0.3
"""a frame is doubtful above this probability that a joint is 25 mm off: what a needless look costs, of that and what a wrong frame
costs that nobody looks at, which is taken for a little more than two looks: 1 / (1 + 2.3)"""
ALWAYS = -5.3
SIGNS = {"outline": 12.0, "few": 1.2, "open": 0.9, "curled": 2.3, "odd": 0.35, "moved": 0.6}
"""logarithm of the odds of a gross error: ALWAYS where no sign tells of one, and what each adds times its size; none subtracts"""
PART = (0.4, 0.6)
"""the same of a part, at 10 mm: always, and times the frame's"""
