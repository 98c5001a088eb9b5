"""`handtrack simulate`: a recording with truth."""

from __future__ import annotations

import argparse

from handtrack.session.simulate import Simulation, simulate
from handtrack_app.commands.progress import progress_bar


def run(args: argparse.Namespace) -> int:
    """Render the session folder and name it."""
    what = Simulation(
        cameras=args.cameras,
        frames=args.frames,
        size=(args.size[0], args.size[1]),
        motion=args.motion,
        side=args.side,
        scale=args.scale,
        forearm=args.forearm,
        distance_m=args.distance,
        fps=args.fps,
        images=not args.no_images,
        distortion=args.distortion,
        init_noise_m=args.init_noise_mm * 1e-3,
        seed=args.seed,
    )
    what.check()
    with progress_bar(args.frames * args.cameras, "rendering") as bar:
        simulate(args.out, what, lambda _done, _total: bar.update())
    print(f"simulated session in {args.out}; open it with: handtrack open {args.out}")
    return 0
