"""The engine as the page calls it: all methods that its parts mark with `command`; a type only, for whoever checks the calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the page's process has no use for what the engine imports
    from handtrack_app.engine.masks.mask_service import MaskService
    from handtrack_app.engine.open_session import OpenSession
    from handtrack_app.engine.pictures.cloud_service import CloudService
    from handtrack_app.engine.posing.pin_service import PinService
    from handtrack_app.engine.posing.pose_service import PoseService
    from handtrack_app.engine.review.review_service import ReviewService
    from handtrack_app.engine.tuning.tuning_service import TuningService

    class Engine(  # type: ignore[misc]
        OpenSession,
        PoseService,
        PinService,
        TuningService,
        ReviewService,
        CloudService,
        MaskService,
    ): ...
else:
    Engine = object
