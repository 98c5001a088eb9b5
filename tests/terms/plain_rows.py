"""Systems of rows, for terms' plain forms."""

from handtrack.terms.term import JointSystem, Sums, add_rows


def system_of(bones: int, cost: float, *rows) -> JointSystem:
    """Return what `add_rows` makes of rows by the twists of so many bones."""
    sums = Sums.zero(bones, 6)
    add_rows(sums, *rows)
    return JointSystem(cost, sums.gradient, sums.hessian)
