"""The cloud service: what the page sees of clouds and of the surface, and the settings of [clouds]."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import Array, Bytes, Floats
from handtrack.capture.clouds.cloud_filters import (
    FilterReport,
    fit_skin_ellipse,
    random_part,
)
from handtrack.capture.clouds.point_cloud import EMPTY, PointCloud
from handtrack.capture.clouds.stereo import StereoMatcher
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface, surface_mesh
from handtrack.session.session_file import CloudSettings
from handtrack.session.session_state import decide
from handtrack.session.sources.clouds import hand_region
from handtrack.session.sources.skin_samples import painted_skin
from handtrack.tracking.frame.terms.cloud_terms import fitted_surface
from handtrack_app.engine import edits
from handtrack_app.engine.camera_pictures import (
    NARROW_PX,
    WIDE_PX,
    CameraPictures,
    as_wide,
    points_picture,
    stereo_pictures,
    stereo_words,
)
from handtrack_app.engine.document import Document, Moment
from handtrack_app.engine.document_snapshots import cloud_card
from handtrack_app.engine.service import FramePictures, Service
from handtrack_app.protocol import (
    Box,
    CloudPicture,
    CloudSelection,
    CloudSnapshot,
    Command,
    Notice,
    SurfaceSnapshot,
)

_SHOWN = 20_000  # points sent to the page at most
_SPACING_M = 0.0035  # between vertices of the surface shown
_BODY_SPACING_M = 0.015
_LEAST_SLOPE = 0.3  # of the distance; deep inside it has none


@dataclass(frozen=True, eq=False)
class CloudMoment(Moment):
    """A moment, and what is shown of clouds there."""

    version: int
    previous: BonePoses | None
    """the hand that the cloud is cropped to; None before the hand has a place"""
    wanted: CloudSelection

    @property
    def surface(self) -> MetaballSurface:
        """The surface that the solver fits to clouds."""
        return fitted_surface(self.run.model, self.run.settings.cloud)


class CloudRenderer:
    """Reads, filters and paints; keeps the last filtered cloud and the last matched pair. On the render thread only."""

    def __init__(self, pictures: CameraPictures) -> None:
        self._pictures = pictures
        self._known: tuple[object, PointCloud, Array, tuple[FilterReport, ...]] | None = None
        self._matcher: tuple[object, StereoMatcher] | None = None
        self._painted: tuple[object, ...] = ()
        """what the last picture was made from"""

    def surface(self, moment: CloudMoment) -> SurfaceSnapshot:
        spacing = _SPACING_M if moment.run.model.kind == "hand" else _BODY_SPACING_M
        mesh = surface_mesh(moment.surface, moment.bones, spacing)
        return SurfaceSnapshot(
            moment.frame,
            moment.version,
            mesh.carried(moment.bones)[0].astype(np.float32),
            mesh.faces.astype(np.uint32),
        )

    def cloud(self, moment: CloudMoment) -> CloudSnapshot:
        measured, fate, reports = self._filtered(moment)
        if measured is None:
            none, far = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
            words = "This frame has no cloud."
            return CloudSnapshot(moment.frame, none, None, far, 0, 0, (), words)
        kept = np.flatnonzero(fate == len(reports))
        shown = kept[random_part(len(kept), _SHOWN)]
        points = measured.points[shown]
        words = ""
        if not len(kept):
            words = nothing_left(reports)
        elif moment.previous is None and moment.run.session.cloud_filters.crop_m is not None:
            words = "The hand has no place yet: nothing is cropped to it."
        elif len(shown) < len(kept):
            words = f"{len(shown)} of {len(kept)} points are drawn."
        return CloudSnapshot(
            moment.frame,
            points.astype(np.float32),
            None if measured.colors is None else measured.colors[shown],
            _residual_mm(moment, points).astype(np.float32),
            len(measured),
            len(kept),
            reports,
            words,
        )

    def images(self, moment: CloudMoment) -> CloudPicture | None:
        """Return the cameras' pictures with the points; None where they would be those of the last time."""
        measured, fate, reports = self._filtered(moment)
        if self._is_painted(moment.frame, moment.wanted, fate):
            return None
        measured = measured or EMPTY
        names = tuple(report.name for report in reports)
        views = map(moment.run.session.view, _cameras(moment))
        return _picture(moment, {
            view.name: points_picture(
                self._pictures.plain(view, moment.frame), view.camera.without_distortion(), measured.points, fate,
                names, _width(moment),
            )
            for view in views
        })  # fmt: skip

    def stereo(self, moment: CloudMoment, pair: tuple[str, str]) -> CloudPicture | None:
        """Return how a pair is matched; None where it would be the picture of the last time."""
        session, frame = moment.run.session, moment.frame
        settings = (session.file.clouds or CloudSettings()).matching
        key = (pair, settings, id(session.rig))
        if self._is_painted(frame, moment.wanted, key):
            return None
        if self._matcher is None or self._matcher[0] != key:
            self._matcher = (
                key,
                StereoMatcher(session.rig[pair[0]], session.rig[pair[1]], settings),
            )
        matcher = self._matcher[1]
        images = [session.image(name, frame) for name in pair]
        if images[0] is None or images[1] is None:
            missing = pair[0] if images[0] is None else pair[1]
            return _picture(moment, {}, f"{missing} has no image here.")
        view = matcher.match(
            images[0], images[1], *(session.view(name).hand_pixels(frame) for name in pair)
        )
        made = stereo_pictures(view)
        small = {name: as_wide(one, _width(moment)) for name, one in made.items()}
        return _picture(moment, small, stereo_words(view, matcher.pair))

    def _is_painted(self, *made_from: object) -> bool:
        before, self._painted = self._painted, made_from
        return len(before) == len(made_from) and all(
            a is b or (not isinstance(a, np.ndarray) and a == b)
            for a, b in zip(before, made_from, strict=True)
        )

    def _filtered(
        self, moment: CloudMoment
    ) -> tuple[PointCloud | None, Array, tuple[FilterReport, ...]]:
        """Return the measured cloud, which filter dropped each point, and what the filters did."""
        session = moment.run.session
        filters, measured = session.cloud_filters, session.measured_cloud(moment.frame)
        if measured is None:
            return None, np.zeros(0, np.int8), ()
        crop, near = None, b""
        # which points are near: the same ones, wherever the hand moves among them
        if moment.previous is not None and filters.crop_m is not None:
            crop = hand_region(moment.run.model, moment.previous)
            near = crop.near(measured.points, filters.crop_m).tobytes()
        key = (id(measured), filters, near)
        if self._known is None or self._known[0] != key:
            fate, reports = filters.dropped_by(measured, crop, session.cloud_camera_centres)
            self._known = (key, measured, fate, reports)
        return self._known[1:]


def _width(moment: CloudMoment) -> int:
    return WIDE_PX if moment.wanted.wide else NARROW_PX


def _picture(moment: CloudMoment, images: dict[str, Bytes], words: str = "") -> CloudPicture:
    return CloudPicture(moment.frame, images, moment.wanted.wide, words)


def nothing_left(reports: tuple[FilterReport, ...]) -> str:
    """Return which filter dropped the last points of a cloud."""
    last = next((report for report in reports if report.before and not report.after), None)
    if last is None:
        return "Nothing was measured in this frame."
    advice = {
        "crop": "Is the model where the cloud is? Pose it (tab Pose), or make 'To hand' larger.",
        "range": "Make 'Nearest' smaller or 'Farthest' larger. Is the unit of length right?",
        "skin": "Take the colour again, or make the ellipse larger.",
    }
    said = advice.get(last.name, "")
    return f"No point is left: the filter '{last.text}' dropped the last {last.before}. {said}".rstrip()


def _residual_mm(moment: CloudMoment, points: Floats) -> Floats:
    """Return the distances to the surface (N,) [mm], to first order: the solver's own grows faster beside an
    ellipsoid's ends than millimetres do.
    """
    if "metaballs" not in moment.run.model.ellipsoids:
        return np.full(len(points), np.nan)
    distance, _, gradient = moment.surface.near(moment.bones, points)
    slope = np.linalg.norm(gradient, axis=1)
    return 1e3 * distance / np.maximum(slope, _LEAST_SLOPE)


def _cameras(moment: CloudMoment) -> tuple[str, ...]:
    """Return the cameras whose pictures are shown: those that measured, at most two."""
    settings = moment.run.session.file.clouds or CloudSettings()
    paired = moment.wanted.pair or (settings.stereo[0] if settings.stereo else ())
    return (settings.depth or paired or moment.run.session.rig.names)[:2]


class CloudService(Service, FramePictures):
    """Clouds, and the surface that the solver fits to them."""

    _wanted = CloudSelection()

    @cached_property
    def _maker(self) -> CloudRenderer:
        return CloudRenderer(self.opened.painter.maker)

    # ---- showing

    @Command(view=True, latest=())
    def want_cloud(self, view: CloudSelection) -> None:
        """Show this of clouds, and of the solver's surface, from now on."""
        self._wanted = view
        self.show()

    @property
    def _wants_cloud(self) -> bool:
        shown = self._wanted.points or self._wanted.picture == "images"
        return shown and self.document.session.has_clouds

    @property
    def is_wanted(self) -> bool:
        """Whether the page looks at something that there is."""
        return self._wanted.surface or self._wants_cloud or self._wanted.picture == "stereo"

    def _show(self, hurried: bool) -> None:
        cloud, stereo = self._wants_cloud, self._wanted.picture == "stereo"
        moment, maker = self._moment(), self._maker
        if self._wanted.surface and not hurried and "metaballs" in moment.run.model.ellipsoids:
            self.opened.render_thread.ask("surface", lambda: maker.surface(moment))
        if cloud and self._wanted.points:
            self.opened.render_thread.ask("cloud", lambda: maker.cloud(moment))
        if cloud and self._wanted.picture == "images" and not hurried:
            self.opened.render_thread.ask("picture", lambda: maker.images(moment))
        if stereo and not hurried:
            pair = self._wanted.pair or cloud_card(self.document).pair
            if pair is not None:
                self.opened.render_thread.ask("picture", lambda: maker.stereo(moment, pair))

    def _moment(self) -> CloudMoment:
        document, now = self.document, self.document.moment
        before, previous = document.frame - 1, now.bones if document.is_posed else None
        if before in document.by_hand or before in document.results:
            previous = document.model.bones_within_limits(document.pose_at(before))
        return CloudMoment(now.frame, now.run, now.bones, document.version, previous, self._wanted)

    # ---- settings

    @Command(edits=True, latest=("values",), tunes=True)
    def set_clouds(self, values: dict[str, object]) -> None:
        """Change settings of [clouds] by name; None: as it is usual, False: off."""
        names, slid = ", ".join(values), edits.is_slid(*values.values())
        now = (self.document.clouds or CloudSettings()).with_values(values)
        self.store.do(f"Clouds: {names}", decide(clouds=now.table), names, is_stroke=slid)

    @Command(edits=True, latest=(), tunes=True)
    def sample_skin(self, frame: int, camera: str, box: Box | None, size: float) -> None:
        """Fit the skin's ellipse to a box x, y, w, h [px] of a camera's image of a frame; None: to all images in which hand is painted."""
        settings, words = skin_in_force(self.document, frame, camera, box, size)
        self.store.do("Colour of skin", decide(clouds=settings.table), tag="skin")
        self.publish(Notice("done", "Skin colour updated", words))


def skin_in_force(
    document: Document, frame: int, camera: str, box: Box | None, size: float
) -> tuple[CloudSettings, str]:
    """Return the settings of [clouds] with the skin's colour from a box of a frame's image or from painted masks, and a sentence
    about it. Raises HandtrackError.
    """
    session, size = document.session, max(float(size), 0.1)
    if box is None:
        patches = painted_skin(session)
        source = f"{len(patches)} painted image{'' if len(patches) == 1 else 's'}"
    else:
        image = session.image(camera, frame)
        if image is None:
            raise HandtrackError(
                f"camera '{camera}' has no image of frame {frame} to take the skin's colour from."
            )
        x, y, width, height = (max(int(v), 0) for v in box)
        patches, source = [image[y : y + height, x : x + width, ::-1]], camera
    skin = fit_skin_ellipse(*patches, size=size)
    red, green = skin.mean
    words = (
        f"{sum(p.size // 3 for p in patches)} pixels of {source}: r = {red:.3f}, g = {green:.3f}."
    )
    return (document.clouds or CloudSettings()).with_values({"skin": skin}), words
