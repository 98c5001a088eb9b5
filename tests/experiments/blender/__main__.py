"""Our BVH and GLB imported by Blender: python -m tests.experiments.blender PYTHON, one that has `bpy` (pip install bpy "numpy<2").

Blender is too large for the environment of the tests, and wants a NumPy of its own.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Axes, Floats
from handtrack.export.registry import export_format
from handtrack.export.shown.mesh import model_skin
from handtrack.export.table import ResultsTable
from tests.export.sequences import KINDS, sample_sequence

INSIDE = Path(__file__).with_name("inside_blender.py")


def main(python: str) -> None:
    """Print how far bones, and vertices of the mesh, are from where they should be, at the worst frame [mm]."""
    for kind in KINDS:
        for name in ("bvh", "glb"):
            table = ResultsTable(sample_sequence(kind)[1])
            with tempfile.TemporaryDirectory() as folder:
                told, out = compared(python, table, name, Path(folder))
            print(f"Blender {out}, {kind}, {name}: {told}", flush=True)


def compared(python: str, table: ResultsTable, name: str, folder: Path) -> tuple[str, str]:
    """Return the errors in words, and Blender's version."""
    path, out = folder / f"poses.{name}", folder / "found.npz"
    export_format(name).write(path, table, up="z")  # as it is in Blender, whose world is then ours
    command = [python, str(INSIDE), str(path), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not out.exists():
        raise RuntimeError(done.stdout + done.stderr)
    with np.load(out) as found:
        names, heads, vertices = list(found["names"]), found["heads"], found["vertices"]
        version, time_s = str(found["version"]), found["time_s"]
    bones = [table.model.skeleton.bone_names.index(bone) for bone in names]
    late = np.abs(time_s - (table.track.time_s - table.track.time_s[0])).max()
    told = f"{len(heads)} frames, times off by {late:.2g} s at most, bones {worst(heads, table.track.T_world_bone[..., :3, 3][:, bones]):.2g} mm"
    if len(vertices):
        told += f", vertices {worst(vertices, model_skin(table.model).carried(table.track.T_world_bone)):.2g} mm"
    return told, version


def worst(found: Floats[*Axes, D3], wanted: Floats[*Axes, D3]) -> float:
    """Return the largest distance of points [mm]."""
    if found.shape != wanted.shape:
        raise RuntimeError(f"{found.shape} points found, {wanted.shape} written")
    return float(1e3 * np.linalg.norm(found - wanted, axis=-1).max())


if __name__ == "__main__":
    main(sys.argv[1])
