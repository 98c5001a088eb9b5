"""The stage: all that stands in the scene, and how it follows snapshots and display options."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import viser

from handtrack.arrays import Floats
from handtrack.geometry.camera import Camera
from handtrack_app.page.page import Client, Display, Page, put
from handtrack_app.page.scene.grips import Grips, RootHandle
from handtrack_app.page.scene.looking import (
    CameraRig,
    CloudView,
    Looking,
    Moments,
    Pointed,
    pixel_box,
)
from handtrack_app.page.scene.model_view import (
    Ghosts,
    HandView,
    add_surroundings,
    hand_balls,
)
from handtrack_app.page.scene.viewpoint import (
    begin_at,
    first_view,
    hand_view,
    upward,
)
from handtrack_app.palette import SURFACE
from handtrack_app.protocol import (
    BEFORE,
    HAND_REACH_M,
    Box,
    CloudSelection,
    CloudSnapshot,
    GuessesSnapshot,
    PictureSnapshot,
    PoseSnapshot,
    ScoreSnapshot,
    SessionSnapshot,
    SurfaceSnapshot,
)

_OVER_IMAGE, _AROUND_BONES, _AMONG_POINTS = 0.3, 0.45, 0.6
"""most opacity of the hand over a camera's image, and around what is inside it"""


class Stage:
    """Owns the scene's handles."""

    def __init__(self, page: Page, pose: PoseSnapshot) -> None:
        self.page, self.session, self.pose = page, page.state.session, pose
        server, session = page.server, self.session
        self.cloud = CloudView(server)
        corner, first = np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32)
        self.surface = server.scene.add_mesh_simple(
            "/surface", corner, first, color=SURFACE, visible=False
        )
        self._surface_at: tuple[int, int, str] | None = None
        self.moments = Moments()
        self.take_guess: Callable[[int], None] = lambda rank: None
        self.score: ScoreSnapshot | None = None
        self.cameras = CameraRig(server, "/cameras", session)
        self.cameras.size(pose.middle)
        self.hand = HandView(server, session)
        self._drawing = threading.Lock()
        """while the hand is moved to the pose shown: a thread that is late would leave it at one before"""
        self.root = RootHandle(server, page.edit_pose, self._larger)
        self.looking = Looking(page, self.name_of, self.cameras.cards)
        self.grips = Grips(page, self._grasped, pose)
        self.ghosts = Ghosts(
            server,
            lambda n: self.take_guess(n),  # noqa: PLW0108 - it is set later
        )
        add_surroundings(server, pose.middle, upward(session), session.reach_m)
        begin_at(server, first_view(session, pose.middle))

    def fit(self, session: SessionSnapshot) -> None:
        """Fit the scene to what changed of the session; the hand is rebuilt when its model changes."""
        before, self.session = self.session, session
        self.cameras.move(session)
        if (before.bone_names, before.model) != (session.bone_names, session.model):
            self.hand.remove()
            self.hand = HandView(self.page.server, session)
            self.grips.let_go()
        if not session.clouds.source:
            self.cloud.cloud = None
        self.page.redraw()

    # ---- options

    def apply(self) -> None:
        """Show and hide as the display options say."""
        display = self.display
        with self.page.server.atomic():
            self.cloud.show(display, self.moments)
            self.cloud.colour(display)
            self.cameras.show(display)
            self._draw()
            self.grips.freely = bool(display.mode) and not display.handle
            self.grips.place()

    @property
    def marking(self) -> bool:
        """Whether somebody drags a box over an image or paints it: nothing stands before it."""
        return any(one.box or one.pointed for one in self.page.clients)

    @property
    def display(self) -> Display:
        """What is drawn now."""
        display = self.page.state.display
        if not (self.marking or display.hidden):
            return display
        # without all that stands before the image
        return replace(display, mode="", cloud=False, ghosts=False, handle=False, truth=False)

    def _draw(self) -> None:
        """Show what there is of the pose shown, beside clouds and cameras."""
        with self._drawing:
            display, pose = self.display, self.pose
            self.ghosts.show(display.ghosts, pose.frame)
            self._draw_hand(display, pose)
            self.hand.show_truth(pose, display.truth)
            # the handle of the whole hand; not at a pose that is only looked at
            put(self.root.control, visible=display.handle and pose.origin != BEFORE)
        self.looking.place(display.field, pose.middle, self._larger)

    def _draw_hand(self, display: Display, pose: PoseSnapshot) -> None:
        """Show ellipsoids or the surface: this one takes longer, so in motion the ellipsoids stand for it."""
        state = self.page.state
        still = not (state.playing or state.tracking)
        made_of = pose.frame, pose.version, self.session.model
        ready = still and display.surface and self._surface_at == made_of
        self.hand.show(display, ready)
        if self._fits(pose):
            self.hand.move_to_pose(pose, display)
        put(self.surface, visible=ready)
        # what stands in the hand, and behind it, is seen through it
        points = self.cloud.points.visible and display.cloud_colour == "residual"
        most = {
            _OVER_IMAGE: self.looking.anyone, _AROUND_BONES: display.skeleton,
            _AMONG_POINTS: points or self.ghosts.bones.visible,
        }  # fmt: skip
        opacity = min(display.opacity, *(one for one, there in most.items() if there), 1.0)
        for node in (self.hand.ellipsoids, *self.hand.parts, self.surface):
            put(node, opacity=None if opacity > 0.99 else opacity)

    @property
    def _larger(self) -> float:
        """How many times larger than a hand the model is: what is drawn around it grows alike."""
        return self.session.reach_m / HAND_REACH_M

    def wanted(self) -> dict[str, tuple[Any, ...]]:
        """Return which pictures, and what of surface and clouds, the display options need: the engine's commands and arguments."""
        display = self.page.state.display
        paint = "field" if display.field else display.paint
        surface = display.surface and not self.page.state.playing
        cloud = CloudSelection(
            display.cloud, display.cloud_picture, display.cloud_wide, display.stereo_pair, surface
        )
        return {
            "want_pictures": (
                display.images,
                paint,
                self.looking.pictures(self.display.field),
                display.masks,
            ),
            "want_cloud": (cloud,),
        }

    def _grasped(self, client: Client) -> Camera | None:
        """Return the camera through which a page can take hold of the hand: not while its image is painted or marked."""
        return None if self.marking else self.looking.card(client)

    # ---- snapshots

    def show_pose(self, pose: PoseSnapshot, move_handle: bool) -> None:
        """Move the hand."""
        if not self._fits(pose):
            return
        self.pose = pose
        with self.page.server.atomic():
            self.moments.show(pose.frame)
            self.clear_late()
            self._draw()
            if move_handle:
                self.root.show_at(pose.values[:6])
        self.looking.show_hand(*hand_balls(self.session, pose))
        self.grips.show(pose)
        self._name_cameras()

    def show_score(self, score: ScoreSnapshot) -> None:
        """Show a pose's overlap beside the cameras' pictures."""
        self.score = score
        self._name_cameras()

    def name_of(self, camera: str) -> str:
        """Return a camera's name, and its mask's overlap where the pose shown is scored."""
        score, pose = self.score, self.pose
        if score is None or not score.is_of(pose.frame, pose.values):
            return camera
        share = score.overlap.get(camera)
        return camera if share is None else f"{camera}  {share:.2f}"

    def _name_cameras(self) -> None:
        for camera, label in self.cameras.labels.items():
            put(label, text=self.name_of(camera))
        self.looking.draw_close_ups()

    def _fits(self, pose: PoseSnapshot) -> bool:
        """Whether a pose is of the model that stands in the scene, and not of the one before."""
        wanted = len(self.session.radii), len(self.session.bone_names)
        return (len(pose.centre), len(pose.bone_position)) == wanted

    def show_pictures(self, pictures: PictureSnapshot) -> None:
        """Show the cameras' pictures, or the masks over them."""
        if not self.moments.fits(pictures.frame):
            return
        display = self.page.state.display
        small = pictures.masks if display.masks else pictures.thumbnails
        if display.images and small:
            self.cameras.show_images(small, pictures.frame)
        self.looking.show(pictures.screens, pictures.frame)

    def clear_late(self) -> None:
        """Show nothing any more that is of a frame that was shown too long ago. Called now and then."""
        self.looking.clear_late(self.moments)
        self.cameras.clear_late(self.moments)
        self.cloud.show(self.display, self.moments)

    def show_surface(self, surface: SurfaceSnapshot) -> None:
        """Show the solver's surface, if it is that of the frame shown."""
        if surface.frame != self.pose.frame:
            return
        with self.page.server.atomic():
            self.surface.vertices = surface.vertices
            self.surface.faces = surface.faces.astype(np.uint32)
            self._surface_at = surface.frame, surface.version, self.session.model
            self._draw()

    def show_guesses(self, guesses: GuessesSnapshot) -> None:
        """Draw the poses that a frame may have."""
        with self.page.server.atomic():
            self.ghosts.update(guesses)
            self._draw()
        if guesses.is_new:
            self._turn_to(np.median(guesses.position[guesses.owner == 0], axis=0))

    def _turn_to(self, hand: Floats) -> None:
        """Look at a hand that was found somewhere (3,) [m]."""
        self.cameras.size(hand)
        view = hand_view(self.session, hand)
        for client in self.page.clients:
            self.looking.look_freely(client, view)

    def show_cloud(self, cloud: CloudSnapshot) -> None:
        """Show a frame's cloud."""
        with self.page.server.atomic():
            self.cloud.take(cloud, self.display)
            self.cloud.show(self.display, self.moments)
            self._draw()

    # ---- views

    def look(
        self,
        camera: str | None,
        client: Client,
        everything: bool = False,
    ) -> None:
        """Let a page look through a camera, or freely (None) at the hand or at everything, or at what `ALL` cameras see."""
        self._end_mark(client)
        self.looking.hush(client)
        self.looking.set_through(client, camera)
        if camera is None:
            view = hand_view(self.session, self.pose.middle, everything)
            self.looking.look_freely(client, view)
        self.page.redraw()

    def paint_on(self, camera: str, client: Client, task: str, pointed: Pointed) -> None:
        """Look through a camera at its mask, and tell where its image is touched, until somebody looks elsewhere. task: in words."""
        if camera not in self.cameras.cards:
            return
        self.look(camera, client)
        self.looking.set_paint(client, "mask")
        self.looking.listen(client, pointed)
        self.page.redraw()
        self.looking.ask(client, task)

    def mark_box(
        self,
        camera: str,
        client: Client,
        over: str,
        marked: Callable[[Box], None],
    ) -> None:
        """Look through a camera, and hand over the next rectangle dragged over its image. over: what it is to show, in words."""
        if camera not in self.cameras.cards:
            return
        self.look(camera, client)
        card = self.cameras.cards[camera]

        @client.handle.scene.on_rect_select()
        def once(event: viser.SceneRectSelectEvent) -> None:
            if client.box is None:
                return  # it looked elsewhere meanwhile
            self._end_mark(client)
            self.page.redraw()
            box = pixel_box(event.client.camera, card, (event.screen_min, event.screen_max))
            if box is not None:
                marked(box)

        client.box = once
        self.page.redraw()
        words = f"Drag a box over {over}. The model is hidden until then; key 0 returns to the orbit view."
        self.looking.ask(client, words)

    def _end_mark(self, client: Client) -> None:
        """Wait for a box no more: drags move the picture again."""
        waits, client.box = client.box, None
        if waits is not None:
            client.handle.scene.remove_rect_select_callback(waits)
            self.looking.ask(client, "")
