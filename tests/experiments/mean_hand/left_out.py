"""How far hands lie from a mean that they are not in: python -m tests.experiments.mean_hand.left_out DEFINITION MAKEHUMAN DATA --json

DEFINITION, MAKEHUMAN: as of `mean`. DATA: a folder with WebXR's and UmeTrack's meshes, which are in no mean. Prints the mean distance of
hands' skins from the ellipsoids about their own joints, straight and at one length [mm]: before, from the mean of all, and from that of the others.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from tests.experiments.honesty.meshes import read_meshes
from tests.experiments.mean_hand.fit import Flat, Surface, flat, off_surface
from tests.experiments.mean_hand.mean import families, mean_definition, read_start


def away_mm(definition: dict[str, Any], hand: Flat) -> float:
    surface = Surface.of([(hand, 1.0)], definition)
    return float(np.abs(off_surface(definition["ellipsoids"]["fine"], surface)).mean())


def main() -> None:
    start, makehuman, data = map(Path, sys.argv[1:4])
    definition = read_start(start)
    hands = families(definition, makehuman)
    every = mean_definition(definition, hands)
    rng = np.random.default_rng(0)
    never = [flat(mesh, definition, rng) for mesh in read_meshes(data).values()]
    found: dict[str, dict[str, float]] = {
        h.name: {"before_mm": away_mm(definition, h), "left_out_mm": away_mm(every, h)}
        for h in never
    }
    rows = []
    for hand in hands["makehuman"]:
        others = [h for h in hands["makehuman"] if h is not hand]
        without = mean_definition(definition, hands | {"makehuman": others})
        rows.append([away_mm(d, hand) for d in (definition, every, without)])
    names = ("before_mm", "in_it_mm", "left_out_mm")
    found["makehuman"] = dict(zip(names, np.mean(rows, axis=0).tolist(), strict=True))
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
