"""docs/contributing/adding_a_term.md: its example is a term, fast and right, as it is written."""

import importlib.util
import re

import pytest

from tests.conftest import REPOSITORY

PAGE = REPOSITORY / "docs" / "contributing" / "adding_a_term.md"


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Return the page's term and its test as one module."""
    path = tmp_path_factory.mktemp("example") / "table.py"
    found = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    path.write_text("\n".join(found), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("table_of_the_page", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_its_derivatives_are_right(example, rng):
    example.test_derivatives(rng)
