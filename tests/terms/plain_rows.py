"""Systems of rows, for terms' plain forms."""

from handtrack.terms.bone_system import JointSystem, Sums
from handtrack.terms.rows import Rows


def system_of(rows: Rows, bones: int) -> JointSystem:
    """Return what rows add up to, by the twists or fields of so many bones."""
    sums = Sums.zero(bones, rows.motion.shape[1])
    return JointSystem(rows.add_to(sums), sums.gradient, sums.hessian)
