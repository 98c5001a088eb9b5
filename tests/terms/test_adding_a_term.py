"""docs/contributing/adding_a_term.md: its example is a term, fast and right, as it is written."""

import importlib.util
import re

import numpy as np
import pytest

from handtrack import load_model
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
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


def test_it_lifts_a_hand_out_of_the_table(example):
    model = load_model()
    start = model.rest_params()
    tips = [k for k, name in enumerate(model.joint_names) if name.endswith("_tip")]
    heights = model.joint_positions(model.bones(start))[tips, 2]
    up = np.array([0.0, 0.0, 1.0])
    assert example.TableTerm(model, up, heights.min() - 0.01).cost(model.bones(start)) == 0.0
    term = example.TableTerm(model, up, heights.max() + 0.01)
    found = solve(Problem(model, [term]), start).params
    lifted = model.joint_positions(model.bones(found))[tips, 2]
    assert (lifted > term.height_m - 1e-4).all()
