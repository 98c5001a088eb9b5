"""What a batch is to do: recordings that match, and what each would be made from."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.session.layout import SESSION_FILE, TRACKS_FOLDER
from handtrack.session.session import Session
from handtrack.session.takes.take_about import files_read
from handtrack.session.takes.versions import versions_in_use

LEDGER_FILE = "ledger.jsonl"
_MADE = {TRACKS_FOLDER, "versions"}
"""folders of a session that tracking writes: they are no input"""


@dataclass(frozen=True)
class Recording:
    """One session folder of a batch."""

    name: str
    """of its files in the output folder; each differs"""
    folder: Path
    digest: str
    """of what is read of it, what was asked for, and the versions that do it: the same digest gives the same bytes"""


def recordings(patterns: Sequence[str], words: Sequence[str], out: Path) -> list[Recording]:
    """Return the recordings that patterns name, each once, in order of their paths.

    A pattern is a session folder, its session.toml, or either with * ? [ ] and **. words: how `track` is asked. A folder
    without session.toml is a recording too, and will be refused by name. Raises HandtrackError where a pattern matches nothing.
    """
    folders: dict[Path, None] = {}
    for pattern in patterns:
        paths = [Path(p) for p in sorted(glob.glob(os.path.expanduser(pattern), recursive=True))]
        found = [path.parent if path.name == SESSION_FILE else path for path in paths]
        found = [path.resolve() for path in found if path.is_dir() and not _is_output(path, out)]
        if not found:
            raise HandtrackError(
                f"{pattern}: no session folder matches; expected folders with a {SESSION_FILE}, such as 'recordings/*', or "
                f"'recordings/**/{SESSION_FILE}' for all below a folder."
            )
        folders |= dict.fromkeys(found)
    ordered = sorted(folders)
    asked = [*words, *(f"{name} {version}" for name, version in sorted(versions_in_use().items()))]
    names = _names(ordered)
    return [Recording(n, f, _digest(*asked, *_inputs(f))) for n, f in zip(names, ordered, strict=True)]  # fmt: skip


def _is_output(path: Path, out: Path) -> bool:
    return path.resolve() == out.resolve() or (path / LEDGER_FILE).is_file()


def _names(folders: Sequence[Path]) -> list[str]:
    """Return a file name for each folder: its path below what all share."""
    above = Path(os.path.commonpath([folder.parent for folder in folders])) if folders else Path()
    names = ["__".join(folder.relative_to(above).parts) for folder in folders]
    twice = {name for name in names if names.count(name) > 1}
    return [f"{n}-{_digest(str(f))[:6]}" if n in twice else n for n, f in zip(names, folders, strict=True)]  # fmt: skip


def _inputs(folder: Path) -> list[str]:
    """Return what stands for everything that is read of a session: contents of small files, sizes and times of large ones."""
    small = sorted(p for p in folder.iterdir() if p.suffix in (".toml", ".json", ".csv", ".npz") and p.is_file())  # fmt: skip
    told = [f"{path.name} {_digest(path.read_bytes())}" for path in small if path.stat().st_size < 1 << 20]  # fmt: skip
    try:
        read = files_read(Session.open(folder))
        return [*told, *(f"{what} {digest}" for what, digest in sorted(read.items()))]
    except (HandtrackError, OSError):  # it will be refused; again, as long as nothing in it changes
        return [*told, *_listing(folder)]


def _listing(folder: Path) -> list[str]:
    rows = []
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(set(folders) - _MADE)
        for name in sorted(files):
            stat = os.stat(Path(place, name), follow_symlinks=False)
            rows.append(
                f"{os.path.relpath(place, folder)}/{name} {stat.st_size} {stat.st_mtime_ns}"
            )
    return rows


def _digest(*parts: str | bytes) -> str:
    total = blake2b(digest_size=16)
    for part in parts:
        total.update(part.encode() if isinstance(part, str) else part)
        total.update(b"\0")
    return total.hexdigest()
