"""Values of a TOML file are changed however it is written; comments and everything else stay."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from handtrack.errors import HandtrackError
from handtrack.files.toml_edit import changed_toml, edit_toml

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

REST = "# mine\n[session]\nformat = 1  # of the file\n\n[[camera]]\nname = 'left' # west\n"
SPELLINGS: dict[str, tuple[str, str, Any, str]] = {
    "plain": ("[tracking]\ncloud.weight = 2.0 # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "own table": ("[tracking.cloud] # T\nweight = 2.0\n", "tracking.cloud.weight", 0.5, "0.5"),
    "at the root": ("tracking.cloud.weight = 2.0 # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "quoted key": ("[tracking]\n'cloud'.\"weight\" = 2.0 # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "spaces": ("[ tracking ]\ncloud.weight = 2.0 # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "quoted table": ('["tracking"]\ncloud.weight = 2.0 # T\n', "tracking.cloud.weight", 0.5, "0.5"),
    "inline": ("tracking = { cloud = { weight = 2.0 } } # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "inline below": ("[tracking]\ncloud = { weight = 2.0 } # T\n", "tracking.cloud.weight", 0.5, "0.5"),
    "over lines": (
        "[tracking]\nsilhouettes.bands_mm = [\n 8, # first\n 2.0,\n] # T\n",
        "tracking.silhouettes.bands_mm", (8.0, 0.5), "0.5",
    ),
    "clouds": ("[clouds]\ncrop_m = 2.0 # T\n", "clouds.crop_m", 0.5, "0.5"),
    "clouds, array over lines": (
        "[clouds]\nstereo = [\n  ['a', 'b'], # front\n]\ncrop_m = 2.0 # T\n", "clouds.crop_m", 0.5, "0.5",
    ),
    "clouds inline": ("clouds = { files = 'c', crop_m = 2.0 } # T\n", "clouds.crop_m", 0.5, "0.5"),
    "clouds, spaces": ("[ clouds ]\ncrop_m = 2.0 # T\n", "clouds.crop_m", 0.5, "0.5"),
    "clouds, skin a table": (
        "[clouds]\nfiles = 'c'\n[clouds.skin] # T\nmean = [0.4, 0.3]\nsize = 2.0\n",
        "clouds.skin", {"mean": (0.4, 0.3), "size": 0.5}, "0.5",
    ),
    "scale": ('[hand]\nscale = "fit" # T\n', "hand.scale", "hand.json", '"hand.json"'),
    "scale, single quotes": ("[hand]\nscale = 'fit' # T\n", "hand.scale", "hand.json", '"hand.json"'),
    "scale at the root": ('hand.scale = "fit" # T\n', "hand.scale", "hand.json", '"hand.json"'),
    "scale inline": ('hand = { scale = "fit" } # T\n', "hand.scale", "hand.json", '"hand.json"'),
    "scale, quoted key": ('[hand]\n"scale" = "fit" # T\n', "hand.scale", "hand.json", '"hand.json"'),
}  # fmt: skip
"""text, name, new value, how it is written"""


@pytest.mark.parametrize("way", SPELLINGS)
def test_every_spelling_is_edited(way: str) -> None:
    given, name, value, written = SPELLINGS[way]
    text = REST.replace("\n[[camera]]", f"\n{given}\n[[camera]]")
    if not given.startswith("["):
        text = given + REST
    changed = changed_toml(text, {name: value})
    old = next(word for word in ("2.0", '"fit"', "'fit'") if word in given)
    expected = given.replace(" 8,", " 8.0,").replace(old, written)
    assert changed == text.replace(given, expected), "this value alone differs, all comments stay"
    table, *keys = name.split(".")
    found = tomllib.loads(changed)[table]
    for key in keys:
        found = found[key]
    assert found == (
        {"mean": [0.4, 0.3], "size": 0.5}
        if isinstance(value, dict)
        else list(value)
        if isinstance(value, tuple)
        else value
    )


def test_without_a_change_the_text_stays() -> None:
    assert changed_toml(TEXT, {}) == TEXT
    assert changed_toml(TEXT, {"tracking.prior.posture": 4, "hand.scale": None}) == TEXT


def test_values_are_replaced_where_they_stand_with_their_comments() -> None:
    changed = changed_toml(
        TEXT,
        {
            "tracking.solver.iterations": 7,
            "tracking.silhouettes.bands_mm": (8.0, 2.5),
            "tracking.model.forearm": "true",
            "tracking.prior.posture": 1.0,
        },
    )
    assert changed == (
        TEXT.replace("= 20", "= 7").replace("[6, 3, 1]", "[8.0, 2.5]")
        .replace('"a # b"', '"true"').replace("= 4.0", "= 1.0")
    )  # fmt: skip


def test_new_settings_come_to_the_ends_of_their_tables() -> None:
    changed = changed_toml(
        TEXT,
        {
            "tracking.cloud.weight": 0.5,
            "tracking.prior.collision": False,
            "tracking.model.coupling": "21",
        },
    )
    read = tomllib.loads(changed)["tracking"]
    assert read["cloud"] == {"weight": 0.5}
    assert read["model"] == {"forearm": "a # b", "coupling": "21"}
    assert "\ncloud.weight = 0.5\n" in changed
    assert "posture = 4.0\ncollision = false\n" in changed
    assert set(TEXT.splitlines()) <= set(changed.splitlines())


def test_a_value_is_removed_with_its_line() -> None:
    changed = changed_toml(TEXT, {"session.fps": None, "tracking.silhouettes.bands_mm": None})
    assert changed == TEXT.replace("fps = 25.0\n", "").replace(
        "  silhouettes.bands_mm = [6, 3, 1]\n", ""
    )


@pytest.mark.parametrize("end", ["", "\n", "\n\n"])
def test_a_table_is_added_where_there_is_none(end: str) -> None:
    text = "[session]\nformat = 1" + end
    changed = changed_toml(text, {"tracking.solver.iterations": 7})
    assert changed == "[session]\nformat = 1\n\n[tracking]\nsolver.iterations = 7\n"


def test_tables_out_of_order_get_new_settings_too() -> None:
    text = "[tracking]\na = 1\n[session]\nb = 2\n[tracking.cloud]\nweight = 1.0 # c\n"
    changed = changed_toml(
        text, {"tracking.solver.iterations": 7, "tracking.cloud.weight": 0.5, "tracking.x": [1]}
    )
    assert tomllib.loads(changed) == {
        "tracking": {"a": 1, "x": [1], "solver": {"iterations": 7}, "cloud": {"weight": 0.5}},
        "session": {"b": 2},
    }
    assert "weight = 0.5 # c\n" in changed


def test_one_is_not_true() -> None:
    assert changed_toml("a = true\n", {"a": 1}) == "a = 1\n"


def test_what_is_no_table_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "session.toml"
    path.write_text("tracking = 3\n", encoding="utf-8")
    with pytest.raises(HandtrackError) as refused:
        edit_toml(path, {"tracking.cloud.weight": 0.5, "clouds.crop_m": None}, "settings")
    assert str(refused.value) == (
        "session.toml is written in a way that cannot be changed from here ('tracking' is no table). Nothing was written. "
        "To be set by hand: tracking.cloud.weight = 0.5, without clouds.crop_m."
    )
    assert path.read_text(encoding="utf-8") == "tracking = 3\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "text",
    [
        "[session]\nformat = 1\n\n[[camera]]\nname = 'a' # first\n\n[[camera]] # west\nname = 'b'\n\n# of clouds\n[clouds]\nfiles = 'c'\n",
        "camera = [{ name = 'a' }, { name = 'b' }] # T\n",
    ],
    ids=["tables", "inline"],
)
def test_values_of_tables_in_a_list_are_changed_by_their_number(text: str) -> None:
    changed = changed_toml(text, {"camera.0.roi": [1, 2, 3, 4], "camera.1.name": "c"})
    assert tomllib.loads(changed)["camera"] == [
        {"name": "a", "roi": [1, 2, 3, 4]},
        {"name": "c"},
    ]
    assert [part for part in re.findall("#.*", text) if part not in changed] == []
    assert changed_toml(changed, {"camera.0.roi": None, "camera.1.name": "b"}).count("roi") == 0


@pytest.mark.parametrize("name", ["camera.2.name", "camera.0", "camera.x.name"])
def test_what_is_no_table_of_the_list_is_not_changed(name: str) -> None:
    with pytest.raises(ValueError, match="is no table"):
        changed_toml("[[camera]]\nname = 'a'\n", {name: "b"})
