"""Values of a TOML file are changed however it is written; comments and everything else stay."""

import tomllib
from typing import Any

import pytest

from handtrack.files.toml_edit import changed_toml

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
def test_every_spelling_is_edited(way):
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


def test_without_a_change_the_text_stays():
    assert changed_toml(TEXT, {}) == TEXT
    assert changed_toml(TEXT, {"tracking.prior.posture": 4, "hand.scale": None}) == TEXT
