"""[tracking] in session.toml: changed settings replace their lines or come after them, everything else stays."""

from __future__ import annotations

import pytest

from handtrack.errors import HandtrackError
from handtrack.session.tracking_table import with_tracking

TEXT = """# my recording
[session]
format = 1  # of the file
fps = 25.0

[tracking]   # what I found out
solver.iterations = 20  # enough, "really"
  silhouettes.bands_mm = [6, 3, 1]
"model"."forearm" = "a # b"# odd

[tracking.prior]
posture = 4.0

[[camera]]
name = "left"
"""


def test_without_a_change_the_text_stays() -> None:
    assert with_tracking(TEXT, {}) == TEXT


def test_values_are_replaced_where_they_stand_with_their_comments() -> None:
    changed = with_tracking(
        TEXT,
        {
            "solver.iterations": 7,
            "silhouettes.bands_mm": (8.0, 2.5),
            "model.forearm": "true",
            "prior.posture": 1.0,
        },
    )
    assert changed == (
        TEXT.replace("= 20", "= 7").replace("[6, 3, 1]", "[8.0, 2.5]")
        .replace('"a # b"', '"true"').replace("= 4.0", "= 1.0")
    )  # fmt: skip


def test_new_settings_come_to_the_ends_of_their_tables() -> None:
    changed = with_tracking(
        TEXT, {"cloud.weight": 0.5, "prior.collision": False, "model.coupling": "21"}
    )
    assert changed == TEXT.replace(
        "# odd\n", '# odd\ncloud.weight = 0.5\nmodel.coupling = "21"\n'
    ).replace("posture = 4.0\n", "posture = 4.0\ncollision = false\n")


@pytest.mark.parametrize("end", ["", "\n", "\n\n"])
def test_a_table_is_added_where_there_is_none(end: str) -> None:
    text = "[session]\nformat = 1" + end
    changed = with_tracking(text, {"solver.iterations": 7})
    assert changed == "[session]\nformat = 1\n\n[tracking]\nsolver.iterations = 7\n"


def test_dotted_keys_above_all_tables_are_known() -> None:
    text = "tracking.solver.iterations = 20\n[session]\nformat = 1\n"
    changed = with_tracking(text, {"solver.iterations": 7})
    assert changed == text.replace("20", "7")


def test_a_table_with_tables_of_its_own_is_changed() -> None:
    text = "[tracking]\n\n[tracking.cloud]\nweight = 1.0\n\n[session]\nweight = 3.0\n"
    changed = with_tracking(text, {"cloud.weight": 0.5, "cloud.balance": 0.25})
    assert changed == text.replace("weight = 1.0\n", "weight = 0.5\nbalance = 0.25\n")


@pytest.mark.parametrize(
    "text",
    [
        "tracking = { cloud = { weight = 2.0 } }\n",
        "[tracking]\ncloud = { weight = 2.0 }\n",
        "[tracking]\nsilhouettes.bands_mm = [\n 8,\n 4,\n]\n",
    ],
)
def test_what_is_written_otherwise_is_refused(text: str) -> None:
    with pytest.raises(HandtrackError) as refused:
        with_tracking(text, {"cloud.weight": 0.5, "silhouettes.bands_mm": (3.0,)})
    assert str(refused.value) == (
        "the settings in session.toml are written in a way that cannot be changed from here; expected a table [tracking] "
        "with one setting a line. Nothing was written. To be set by hand: cloud.weight = 0.5, silhouettes.bands_mm = [3.0]."
    )
