"""The name of what a drag would take hold of, beside the pointer. viser tells no server of a pointer that only moves: the page's own
script looks, by the grips as they are drawn, and by the rules of `taking_hold.hold_at`.
"""

from __future__ import annotations

import json

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.pins.taking_hold import BEHIND, LEAST_AWAY_M, near_joint_m
from handtrack_app.protocol.snapshots import SessionSnapshot

HOVER_SCRIPT = """
  const held = document.createElement("div");
  held.id = "handtrack-held";
  main.append(held);
  // the name of what the pointer meets first: a joint where it is near one, else the segment; empty beside the hand
  const heldAt = (x, y) => {
    const view = window.__viserMutable, known = window.handtrackHolds, camera = view?.camera;
    let mesh = null;
    view?.nodeRefFromName?.[known?.node]?.traverse((one) => { if (one.getMatrixAt) mesh ??= one; });
    if (mesh === null) return "";
    const Vector = camera.position.constructor, Matrix = camera.matrixWorld.constructor;
    const frame = view.canvas.getBoundingClientRect(), count = known.segments.length;
    const placed = (i) => mesh.getMatrixAt(i, new Matrix()).premultiply(mesh.matrixWorld);
    const eye = new Vector().setFromMatrixPosition(camera.matrixWorld);
    const ahead = new Vector(2 * (x - frame.left) / frame.width - 1, 1 - 2 * (y - frame.top) / frame.height, 0.5).unproject(camera).sub(eye);
    let nearest = Infinity, segment = -1;
    for (let i = 0; i < count; i++) {  // in the ellipsoid's own frame it is a ball of radius 1
      const inverse = placed(i).invert(), from = eye.clone().applyMatrix4(inverse);
      const way = eye.clone().add(ahead).applyMatrix4(inverse).sub(from);
      const a = way.dot(way), b = way.dot(from), root = b * b - a * (from.dot(from) - 1);
      const meets = (-b - Math.sqrt(root)) / a;
      if (root >= 0 && meets > 0 && meets < nearest) { nearest = meets; segment = i; }
    }
    if (segment < 0) return "";
    const at = eye.clone().addScaledVector(ahead, nearest);
    const depth = -at.clone().applyMatrix4(camera.matrixWorldInverse).z;
    let best = known.near * frame.height / 2 / Math.tan(camera.fov * Math.PI / 360) / Math.max(depth, known.least), name = known.segments[segment];
    known.joints.forEach((words, k) => {
      const place = new Vector().setFromMatrixPosition(placed(count + k));
      if (place.distanceTo(at) > known.behind) return;
      const seen = place.project(camera);
      const off = Math.hypot(frame.left + (seen.x + 1) / 2 * frame.width - x, frame.top + (1 - seen.y) / 2 * frame.height - y);
      if (off < best) { best = off; name = words; }
    });
    return name;
  };
  let asked = 0;
  document.addEventListener("pointermove", (event) => {
    Object.assign(held.style, {left: `${event.clientX + 14}px`, top: `${event.clientY + 14}px`});
    if (event.buttons || asked) return;  // while it is dragged the name stays
    asked = requestAnimationFrame(() => {
      asked = 0;
      held.textContent = event.target === window.__viserMutable?.canvas ? heldAt(event.clientX, event.clientY) : "";
    });
  }, true);
"""
"""part of the page's script"""


def name_holds(client: viser.ClientHandle, session: SessionSnapshot, node: str) -> None:
    """Tell a page what its grips are called: a node's instances are the ellipsoids and then the joints."""
    whole = {
        bone: f"{bone.replace('_', ' ')}: moves the whole {session.kind}"
        for bone in session.stem_bones
    }
    bones = [session.bone_names[int(bone)] for bone in session.ellipsoid_bone]
    known = {
        "node": node,
        "near": near_joint_m(session),
        "behind": BEHIND * near_joint_m(session),
        "least": LEAST_AWAY_M,
        "segments": [whole.get(bone, bone.replace("_", " ")) for bone in bones],
        "joints": [joint.replace("_", " ") for joint in session.joint_names],
    }
    internals.run_javascript(client, f"window.handtrackHolds = {json.dumps(known)}")
