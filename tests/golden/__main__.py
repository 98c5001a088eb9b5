"""Record or check the golden results: python -m tests.golden record|check [CASE ...].

A recording says to the bit what tracking gave; checking runs it again and tells for each case whether every array of
poses.npz is the same, and if not by how much its joints moved. Bits hold on one kind of machine only, millimetres anywhere.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from tests.golden.cases import CASES

HERE = Path(__file__).parent
HASHES, JOINTS = HERE / "hashes.json", HERE / "joints.npz"
PROVENANCE = ("settings", "version", "session")
"""what names the program and its settings, not what was found"""


def found(case: str) -> tuple[dict[str, str], np.ndarray, str]:
    """Run a case; return a hash for each array, the joints (F, J, 3) [m], and its statuses in short."""
    with (
        tempfile.TemporaryDirectory() as folder,
        np.load(CASES[case].run(Path(folder))) as poses,
    ):
        arrays = {name: poses[name] for name in sorted(poses.files)}
    counts = " ".join(str(int((arrays["status"] == status).sum())) for status in range(3))
    said = f"{counts} tracked doubtful lost"
    hashes = {n: hashed(array) for n, array in arrays.items() if n not in PROVENANCE}
    return hashes, arrays["joint_positions"], said


def hashed(array: np.ndarray) -> str:
    """Return a short hash of an array's type, shape and bytes."""
    body = f"{array.dtype.str} {array.shape}".encode() + np.ascontiguousarray(array).tobytes()
    return hashlib.sha256(body).hexdigest()[:20]


def compared(case: str, hashes: dict[str, str], joints: np.ndarray) -> tuple[bool, str]:
    """Return whether a case is as recorded to the bit, and what differs."""
    known = json.loads(HASHES.read_text(encoding="utf-8"))[case]
    differing = [name for name, value in known.items() if hashes.get(name) != value]
    added = sorted(set(hashes) - set(known))
    more = f"; new: {', '.join(added)}" if added else ""
    if not differing:
        return True, f"the same to the bit{more}"
    with np.load(JOINTS) as recorded:
        before = recorded[case]
    if before.shape != joints.shape:
        return False, f"joints {joints.shape}, recorded {before.shape}{more}"
    moved = 1e3 * np.linalg.norm(joints - before, axis=-1)
    return False, (
        f"differ: {', '.join(differing)}; joints moved by {moved.mean():.4f} mm on average, "
        f"{moved.max():.4f} at most{more}"
    )


def main() -> int:
    """Return 0, or 1 where a case differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("action", choices=("record", "check"))
    parser.add_argument("case", nargs="*", help=f"of {', '.join(CASES)} (default: all)")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    chosen = args.case or list(CASES)
    all_same = True
    hashes = json.loads(HASHES.read_text(encoding="utf-8")) if HASHES.exists() else {}
    joints = dict(np.load(JOINTS)) if JOINTS.exists() else {}
    with ThreadPoolExecutor(args.jobs) as pool:
        for case, (new, places, said) in zip(chosen, pool.map(found, chosen), strict=True):
            if args.action == "record":
                hashes[case], joints[case] = new, places
                print(f"{case}: recorded, {said}", flush=True)
                continue
            same, text = compared(case, new, places)
            all_same &= same
            print(f"{case}: {text} ({said})", flush=True)
    if args.action == "record":
        ordered = {case: hashes[case] for case in CASES if case in hashes}
        HASHES.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")
        np.savez_compressed(JOINTS, **{case: joints[case] for case in ordered})
    return 0 if all_same else 1


if __name__ == "__main__":
    sys.exit(main())
