"""The 2004 paper's rule for green at any place of a square of green neighbours, as it is written."""

import numpy as np

from handtrack.arrays import Floats


def level_line_value(
    p1: Floats, p2: Floats, p3: Floats, p4: Floats, x: Floats, y: Floats
) -> Floats:
    """Return the values at points (x, y) of squares [−1, 1]² with corners P1 P2 / P3 P4 (y down).

    The paper's rule for any place in the square: the level line through the point is cut with the
    square's sides, both ends are interpolated along their sides, and the point between the ends.
    """
    p1, p2, p3, p4, x, y = np.broadcast_arrays(p1, p2, p3, p4, x, y)
    dx, dy = (((p2 - p1) + (p4 - p3)) / 2, ((p3 - p1) + (p4 - p2)) / 2)
    line_x, line_y = -dy, dx
    flat = (line_x == 0) & (line_y == 0)
    line_x = np.where(flat, 1.0, line_x)  # no gradient: any line will do

    def to_side(sign: float) -> Floats:
        """Return how far along the line, in units of its direction, the square ends."""
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.where(line_x != 0, (np.sign(sign * line_x) - x) / (sign * line_x), np.inf)
            down = np.where(line_y != 0, (np.sign(sign * line_y) - y) / (sign * line_y), np.inf)
        return np.minimum(across, down)

    def on_side(t: Floats) -> Floats:
        """Return the value where the line ends: between two corners, as one coordinate is ±1."""
        u, v = np.clip(x + t * line_x, -1, 1), np.clip(y + t * line_y, -1, 1)
        above, below = p1 + (p2 - p1) * (u + 1) / 2, p3 + (p4 - p3) * (u + 1) / 2
        return above + (below - above) * (v + 1) / 2

    ahead, behind = to_side(1.0), to_side(-1.0)
    share = ahead / np.maximum(ahead + behind, 1e-300)
    return on_side(ahead) * (1 - share) + on_side(-behind) * share
