"""The doctor's look at whether frames of equal number show the same moment in every camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from handtrack.capture.images.frames import FrameSource
from handtrack.capture.images.synchrony import Motion, TimeOffset, time_offsets
from handtrack.session.doctor.finding import Finding, note, ok, warning
from handtrack.session.sources.views import View

if TYPE_CHECKING:
    from handtrack.session.session import Session

_STRETCH = 60  # consecutive frames; two stretches are looked at, and must agree
_FEWEST = 40  # frames of a session that can tell


def check_synchrony(session: Session) -> Iterator[Finding]:
    """Yield a finding about each camera whose frames come late or early against the others', and about what cannot be told."""
    seen = [(v, source) for v in session.views if (source := _moving(v)) is not None]
    if len(seen) < 2 or session.frame_count < _FEWEST:
        return
    offsets = time_offsets([_motions(view, source, session.frame_count) for view, source in seen])
    found = {view.name: offsets.get(i) for i, (view, _) in enumerate(seen)}
    told = {name: offset for name, offset in found.items() if offset and offset.agrees}
    late = sorted((n for n in told if told[n].is_sure), key=lambda n: -abs(told[n].frames))
    for name in late:
        yield warning(_late(session, name, told[name]))
    untold = [name for name in found if name not in told]
    if untold:
        yield note(
            f"the synchronisation of {_listed(untold)} cannot be checked: the motion there matches no "
            "other camera's at any time offset searched."
        )
    if told and not late:
        most = max(abs(offset.frames) for offset in told.values())
        std = max(offset.std for offset in told.values())
        yield ok(
            f"{_listed(list(told))} run together, by what moves: at most {most:.1f} frames apart, ± {std:.1f}."
        )


def _late(session: Session, name: str, offset: TimeOffset) -> str:
    """Return that a camera is late or early, and what to do."""
    which = f"camera '{name}' comes"
    way = "late" if offset.frames > 0 else "early"
    numbers = (
        f"(what moves agrees by {offset.alike:.2f} then, by {offset.as_numbered:.2f} as numbered)"
    )
    if offset.at_edge:
        return (
            f"Do frames of equal number show the same moment? {which} at least {abs(offset.frames):.0f} frames {way} against the "
            f"others {numbers}; no more was searched. Cut the recordings so that they start together, and look again."
        )
    before = session.view(name).settings.lag_s or 0.0
    lag_s = before + offset.frames / session.fps
    rest = abs(lag_s * session.fps - round(lag_s * session.fps))
    whole = (
        f" Tracking takes whole frames, so that {rest:.1f} of one remains: synchronise the cameras where you can."
        if rest >= offset.std
        else ""
    )
    return (
        f"Do frames of equal number show the same moment? {which} {abs(offset.frames):.1f} ± {offset.std:.1f} frames {way} against the "
        f'others {numbers}. Write `lag_s = {lag_s:.4g}` under [[camera]] name = "{name}" in session.toml, and look again; or cut the '
        f"recordings so that they start together.{whole}"
    )


def _listed(names: list[str]) -> str:
    return f"{'cameras' if len(names) > 1 else 'camera'} {', '.join(map(repr, names))}"


def _moving(view: View) -> FrameSource | None:
    return view.mask_files if view.mask_files is not None else view.images


def _motions(view: View, source: FrameSource, count: int) -> tuple[Motion, Motion]:
    """Return what moved in two stretches of a recording."""
    long = min(_STRETCH, count // 2)
    starts = (
        (0, count - long)
        if count <= 2 * _STRETCH
        else (count // 3 - long // 2, 2 * count // 3 - long // 2)
    )
    first, second = (
        Motion(view.camera, (source.read(frame) for frame in range(start, start + long)))
        for start in starts
    )
    return first, second
