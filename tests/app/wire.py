"""A bare client on the wire, as viser's page speaks: for latency, and for input that no page would send."""

from typing import Any

import numpy as np

from handtrack.geometry.rotation import looking_along, quaternion_wxyz
from handtrack_app.page.page import Client
from handtrack_app.page.scene.looking import CameraView
from handtrack_app.page.scene.viewpoint import fov_of
from handtrack_app.workbench import Workbench
from tests.app.waiting import eventually
from tests.experiments.workbench.wire import WireClient

__all__ = ["Browser", "WireClient", "said"]
WHERE = {
    "SetCameraFovMessage": "fov", "SetCameraPositionMessage": "position", "SetCameraLookAtMessage": "look_at",
    "SetCameraUpDirectionMessage": "position",
}  # fmt: skip


def said(wire: WireClient, kind: str) -> list[dict[str, Any]]:
    """Return the messages of a kind that a page was sent."""
    return [message for _, message in list(wire.messages) if message["type"] == kind]


class Browser:
    """What a page does with its camera: as it is told, until the user turns the wheel or walks."""

    def __init__(self, bench: Workbench, wire: WireClient) -> None:
        self.bench, self.wire = bench, wire
        self.number = max(eventually(bench.server.get_clients))
        self.press = wire.trigger

    def drag(
        self, node: str, start: Any, end: Any, modifier: str | None = None, part: int = 0
    ) -> None:
        """Drag a place of the scene; part: of what is drawn many times."""
        said = {
            "type": "SceneNodeDragMessage", "name": node, "owner": str(self.number) if node.startswith("/grips") else "",
            "modifier": modifier, "instance_index": part, "button": "left", "start_position": np.asarray(start, float).tolist(),
            "start_screen_pos": [0.5, 0.5], "end_screen_pos": [0.6, 0.5],
        }  # fmt: skip
        for phase, share in (("start", 0.3), ("update", 0.7), ("end", 1.0)):
            at = start + share * np.subtract(end, start)
            self.wire.send(said | {"phase": phase, "end_position": at.tolist()})

    @property
    def client(self) -> Client:
        return self.bench.page.by_number[self.number]

    @property
    def view(self) -> CameraView | None:
        return self.client.view

    def told(self, kind: str) -> Any:
        """Return the latest value that the page was told."""
        told = [one for one in said(self.wire, kind) if not one.get("initial")]
        return told[-1][WHERE[kind]] if told else None

    def tell(self, position: np.ndarray, look_at: np.ndarray, width: int = 800) -> None:
        """Say where its camera is now."""
        ahead, up = look_at - position, np.array(self.told("SetCameraUpDirectionMessage"))
        wxyz = quaternion_wxyz(looking_along(ahead / np.linalg.norm(ahead), -up).T)
        self.wire.send({
            "type": "ViewerCameraMessage", "wxyz": wxyz.tolist(), "position": position.tolist(),
            "fov": self.told("SetCameraFovMessage"), "near": 0.01, "far": 100.0, "image_height": 600,
            "image_width": width, "look_at": look_at.tolist(), "up_direction": up.tolist(),
        })  # fmt: skip

    def obey(self, width: int = 800) -> None:
        """Stand where it was told to."""

        def told() -> bool:
            view = self.view
            if view is None or self.told("SetCameraFovMessage") != fov_of(view.eye):
                return False
            return np.allclose(
                self.target - self.centre, view.sent[-1].direction, rtol=0, atol=1e-9
            )

        eventually(told)
        self.tell(self.centre, self.target, width)

    @property
    def centre(self) -> np.ndarray:
        return np.array(self.told("SetCameraPositionMessage"))

    @property
    def target(self) -> np.ndarray:
        return np.array(self.told("SetCameraLookAtMessage"))

    def times(self) -> float:
        return 0.0 if self.view is None else self.view.zoom.times
