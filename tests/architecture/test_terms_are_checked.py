"""A term cannot be added without its derivatives being checked."""

import ast

from tests.conftest import REPOSITORY

BASES = {"ObservationTerm", "SurfaceTerm", "ParameterTerm", "FieldTerm"}
CHECKS = ("check_observation_term", "check_parameter_term")


def terms():
    """Return the classes of handtrack/terms that are terms."""
    found = []
    for path in sorted((REPOSITORY / "handtrack" / "terms").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            bases = getattr(node, "bases", ())
            is_term = BASES & {base.id for base in bases if isinstance(base, ast.Name)}
            if is_term and node.name not in BASES:
                found.append(node.name)
    return found


def test_every_term_goes_through_the_finite_difference_check():
    tests = [path.read_text(encoding="utf-8") for path in (REPOSITORY / "tests").rglob("test_*.py")]
    checking = [text for text in tests if any(f"{check}(" in text for check in CHECKS)]
    missing = [name for name in terms() if not any(f"{name}(" in text for text in checking)]
    assert not missing, f"no test in tests/ hands these to one of {CHECKS}: {missing}"
