"""What a session brings back from last time, in a sentence."""

from __future__ import annotations

from handtrack_app.engine.document import Document


def brought_back(document: Document) -> str:
    """Return the sentence; empty where there is nothing."""
    state = document.state
    found = sum(document.decided_pose(frame).found for frame in document.by_hand)
    parts = [
        f"{count} {one if count == 1 else many}"
        for count, one, many in (
            (len(document.results), "tracked frame", "tracked frames"),
            (len(document.by_hand) - found, "pose set by hand", "poses set by hand"),
            (found, "pose found", "poses found"),
            (
                len(state.setting) + len(state.limits) + len(document.unsaved_clouds),
                "changed setting",
                "changed settings",
            ),
        )
        if count
    ]
    return f"Brought back from last time: {', '.join(parts)}." if parts else ""
