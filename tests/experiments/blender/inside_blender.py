"""Run by a Python that has Blender as the library `bpy`: imports a BVH or GLB and writes what it finds. See __main__.py.

It knows nothing of handtrack, so that it needs no more than Blender brings: python inside_blender.py FILE OUT.npz
"""

from __future__ import annotations

import sys

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

CM = 0.01


def main(path: str, out: str) -> None:
    """Write `names` (B,), `heads` (F, B, 3) of the bones and, where there is a mesh, `vertices` (F, V, 3) [m], in Blender's world,
    at every key that was imported, and when these are: `time_s` (F,).
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    if path.endswith(".bvh"):
        bpy.ops.import_anim.bvh(filepath=path, global_scale=CM, update_scene_fps=True)
    else:
        bpy.ops.import_scene.gltf(filepath=path)
    armature = next(thing for thing in scene.objects if thing.type == "ARMATURE")
    meshes = [thing for thing in scene.objects if thing.type == "MESH" and thing.parent == armature]
    keys = sorted({point.co[0] for curve in curves(armature) for point in curve.keyframe_points})
    names = [bone.name for bone in armature.pose.bones]
    heads, vertices = [], []
    for key in keys:
        scene.frame_set(int(np.floor(key)), subframe=float(key - np.floor(key)))
        world = np.array(armature.matrix_world)
        heads.append([world @ (*bone.head, 1.0) for bone in armature.pose.bones])
        graph = bpy.context.evaluated_depsgraph_get()
        for thing in meshes:
            shown = thing.evaluated_get(graph)
            mesh = shown.to_mesh()
            points = np.empty(3 * len(mesh.vertices))
            mesh.vertices.foreach_get("co", points)
            own = np.array(shown.matrix_world)
            vertices.append(points.reshape(-1, 3) @ own[:3, :3].T + own[:3, 3])
            shown.to_mesh_clear()
    np.savez(
        out,
        names=np.array(names),
        heads=np.array(heads)[..., :3],
        vertices=np.array(vertices),
        time_s=(np.array(keys) - keys[0]) / (scene.render.fps / scene.render.fps_base),
        version=bpy.app.version_string,
    )


def curves(armature):
    """Return an action's curves, which Blender 5 keeps in layers."""
    action = armature.animation_data.action
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [c for layer in action.layers for strip in layer.strips for bag in strip.channelbags for c in bag.fcurves]  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
