"""The doctor's look at whether frames of equal number show the same moment in every camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from handtrack.capture.images.frames import FrameSource
from handtrack.capture.images.synchrony import Lag, Motion, agreement, lag_of
from handtrack.session.doctor.finding import Finding, ok, warning
from handtrack.session.seen.views import View

if TYPE_CHECKING:
    from handtrack.session.session import Session

_STRETCH = 60  # consecutive frames; two stretches are looked at, and must agree
_FEWEST = 40  # frames of a session that can tell
_MOST_CAMERAS = 6


def check_synchrony(session: Session) -> Iterator[Finding]:
    """Yield a finding about cameras whose frames come late or early against another's."""
    seen = [(v, source) for v in session.views if (source := _moving(v)) is not None][
        :_MOST_CAMERAS
    ]
    if len(seen) < 2 or session.frame_count < _FEWEST:
        return
    motions = [_motions(view, source, session.frame_count) for view, source in seen]
    late = late_cameras(motions)
    for camera in late:
        before = session.view(camera.name).settings.lag_s or 0.0
        yield warning(
            f"Do frames of equal number show the same moment? From what moves, {camera}. Write "
            f'`lag_s = {before + camera.lag.frames / session.fps:.4g}` under [[camera]] name = "{camera.name}" in '
            "session.toml, and look again; or cut the recordings so that they start together."
        )
    if not late:
        yield ok("nothing that moves speaks against cameras that run together.")


@dataclass(frozen=True)
class LateCamera:
    """A camera that runs apart from others; as a text, in words."""

    name: str
    lag: Lag
    others: str

    def __str__(self) -> str:
        frames = abs(self.lag.frames)
        return (
            f"camera '{self.name}' comes {frames} frame{'s' * (frames > 1)} {'late' if self.lag.frames > 0 else 'early'} "
            f"against {self.others} (it agrees by {self.lag.alike:.2f} then, by {self.lag.as_numbered:.2f} as numbered)"
        )


def late_cameras(motions: Sequence[tuple[Motion, Motion]]) -> list[LateCamera]:
    """Return which cameras run apart from the others, the clearest first. motions: of each camera."""
    count = len(motions)
    alike = {
        (i, k): agreement(motions[i], motions[k])
        for i in range(count)
        for k in range(count)
        if i < k
    }
    alike |= {(k, i): curves[:, ::-1] for (i, k), curves in alike.items()}
    left, late = list(range(count)), []
    while len(left) > 1:
        # one pair may err: of several, the mean counts
        lags: dict[int, Lag | None] = {}
        for k in left:
            curves = [alike[i, k] for i in left if i != k and not np.isnan(alike[i, k]).any()]
            lags[k] = lag_of(np.mean(curves, axis=0)) if curves else None
        apart = {k: lag for k, lag in lags.items() if lag is not None and lag.frames}
        if not apart:
            break
        worst = max(apart, key=lambda k: (apart[k].alike - apart[k].as_numbered, k))
        lag = apart[worst]
        left.remove(worst)
        others = f"'{motions[left[0]][0].camera.name}'" if count == 2 else "the others"
        late.append(LateCamera(motions[worst][0].camera.name, lag, others))
    return late


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
