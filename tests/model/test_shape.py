"""A person's shape in % and mm, and a number of it set by hand."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale, ShapeCovariance
from handtrack.model.model_file import load_model, read_scale, scale_from, scale_table, write_scale
from handtrack.model.size import shape_numbers, with_number

FITTED = HandScale(
    1.05, {"thumb": 0.97}, {"palm_breadth": 0.4, "thumb_base_along": -1.0}, {"index_tip": (0.1, -2.0, 0.5)},
    {"length_mm": 1.0, "overall": 0.01, "palm_breadth": 0.2, "palm_thickness": 0.99}, "mediapipe21",
    ShapeCovariance.of(("overall", "palm_breadth"), np.array([[1e-4, -1e-3], [-1e-3, 0.04]])), "a scan",
)  # fmt: skip


@pytest.mark.parametrize("name", ["me.toml", "me.json"])
def test_the_whole_person_comes_back(tmp_path, name):
    write_scale(tmp_path / name, FITTED, {"thumb": "−3.0 %", "overall": "+5.0 %"})
    again = read_scale(tmp_path / name)
    assert scale_table(again) == scale_table(FITTED)
    np.testing.assert_array_equal(again.covariance.matrix, FITTED.covariance.matrix)


@pytest.mark.parametrize(
    "covariance",
    [
        {"names": ["overall", "thumb"], "rows": [[1.0], [2.0, 1.0]]},
        {"names": ["overall"], "rows": [[1.0], [0.0, 1.0]]},
        {"names": ["overall", "overall"], "rows": [[1.0], [0.0, 1.0]]},
        {"names": ["overall"], "rows": [[float("nan")]]},
        {"names": ["overall"]},
        3,
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance):
    with pytest.raises(HandtrackError):
        scale_from({"overall": 1.0, "covariance": covariance}, "me.toml")


def test_every_number_can_be_set_alone():
    model = load_model(scale=FITTED)
    before = {row.name: row.value for row in shape_numbers(model)}
    for name in before:
        scale = with_number(model, name, 2.0)
        after = {row.name: row.value for row in shape_numbers(load_model(scale=scale))}
        assert after[name] == pytest.approx(2.0, rel=0.1), name
        other = [one for one in before if one != name and one != "overall"]
        np.testing.assert_allclose(
            [after[o] for o in other], [before[o] for o in other], rtol=0.1, atol=1e-6
        )
        assert scale.offsets_mm == FITTED.offsets_mm
        assert name not in scale.std
        assert scale.covariance is not None
        assert name not in scale.covariance.names
    with pytest.raises(HandtrackError):
        with_number(model, "nose", 1.0)
