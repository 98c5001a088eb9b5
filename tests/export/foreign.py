"""What other people's readers find in our files: how far each has the joints from where the result has them [mm].

`python -m tests.export.foreign --json` prints each reader's largest error.
"""

import json
import re
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handtrack.export.motion import marker_name
from handtrack.export.registry import export_format
from handtrack.export.shown import model_skin
from handtrack.export.table import ResultsTable
from tests.export.sequences import KINDS, LOST_ROW, sample_sequence

MOST_MM = 0.05
OF_KNOWN_SKELETONS = ("openpose", "openpose-files", "pose", "mediapipe")


def written(kind: str, name: str, folder: Path) -> tuple[ResultsTable, list[Path]]:
    """Write a sample in a format; return its table and the files."""
    table = ResultsTable(sample_sequence(kind)[1])
    file = export_format(name)
    return table, file.write(folder / f"poses{file.ending}", table)


def library(name: str):
    """Return a foreign reader; the test skips where it is not installed."""
    return pytest.importorskip(
        name, reason=f"{name} reads this format; pip install -e '.[formats]'"
    )


def _worst(found, wanted):
    assert found.shape == wanted.shape
    assert np.isfinite(found).all()
    return float(1e3 * np.linalg.norm(found - wanted, axis=-1).max())


def _worst_seen(points, table):
    """Return the largest error of the frames that are not lost, by points (F, J, 3) [m]."""
    seen = ~table.is_lost
    return _worst(points[seen], table.track.joint_positions[seen])


def trc(kind, folder):
    """OpenSim's reader of marker files."""
    opensim = library("opensim")
    table, (path,) = written(kind, "trc", folder)
    data = opensim.TimeSeriesTableVec3(str(path))
    assert tuple(data.getColumnLabels()) == table.track.joint_names
    assert data.getTableMetaDataAsString("Units") == "mm"
    assert_allclose(data.getIndependentColumn(), table.track.time_s, atol=1e-9)
    flat = data.flatten()  # whose numbers these are
    points = flat.getMatrix().to_numpy().reshape(table.track.joint_positions.shape)
    assert np.isnan(points[LOST_ROW]).all()
    return _worst_seen(1e-3 * points, table)


def mot(kind, folder):
    """OpenSim's kinematics of our generated model, moved by our coordinates."""
    opensim = library("opensim")
    opensim.Logger.setLevelString("Error")
    table, (path,) = written(kind, "mot", folder)
    _, (osim, setup) = written(kind, "osim", folder)
    tool = opensim.InverseKinematicsTool(str(setup), False)  # it owns its tasks
    tasks = tool.getIKTaskSet()
    named = {tasks.get(i).getName() for i in range(tasks.getSize())}
    assert named == {marker_name(name) for name in table.track.joint_names}
    model = opensim.Model(str(osim))
    state = model.initSystem()
    data = opensim.TimeSeriesTable(str(path))
    assert data.getTableMetaDataString("inDegrees") == "yes"
    labels = data.getColumnLabels()
    coordinates = [model.getCoordinateSet().get(name) for name in labels]
    turns = [c.getMotionType() == opensim.Coordinate.Rotational for c in coordinates]
    markers = [model.getMarkerSet().get(name) for name in table.track.joint_names]
    points = np.zeros_like(table.track.joint_positions)
    values = data.getMatrix().to_numpy()
    for row, places in zip(np.where(turns, np.deg2rad(values), values), points, strict=True):
        for coordinate, value in zip(coordinates, row, strict=True):
            coordinate.setValue(state, float(value), False)
        model.realizePosition(state)
        places[:] = [marker.getLocationInGround(state).to_numpy() for marker in markers]
    return _worst(points, table.track.joint_positions)


def bvh(kind, folder):
    """bvhio: every bone's proximal end at every frame, and the ends of the last ones."""
    bvhio = library("bvhio")
    table, (path,) = written(kind, "bvh", folder)
    root = bvhio.readAsHierarchy(str(path))
    ends = {joint.Name: joint.EndSite for joint, _, _ in bvhio.readAsBvh(str(path)).Root.layout()}
    model, track = table.model, table.track
    skeleton = model.skeleton
    leaves = [b for b in range(skeleton.bone_count) if b not in skeleton.parent]
    found, wanted = [], []
    for i in range(len(track)):
        root.loadPose(i)
        by_name = {joint.Name: joint for joint, _, _ in root.layout()}
        for bone, name in enumerate(skeleton.bone_names):
            found.append(np.array(by_name[name].PositionWorld))
            wanted.append(track.T_world_bone[i, bone, :3, 3])
        for bone in leaves:
            name = skeleton.bone_names[bone]
            along = (
                0.0,
                float(np.linalg.norm(ends[name])),
                0.0,
            )  # it turns joints' y along the bone
            found.append(np.array(by_name[name].pointToWorld(along)))
            pose = track.T_world_bone[i, bone]
            wanted.append(pose[:3, 3] + pose[:3, 1] * skeleton.length[bone])
    return _worst(0.01 * np.array(found), np.array(wanted))


def urdf(kind, folder):
    """yourdfpy's kinematics, from the joint states in the CSV beside."""
    pandas = library("pandas")
    table, (path, states) = written(kind, "urdf", folder)
    return _robot_error(_placed(path, table), table, pandas.read_csv(states).to_dict("records"))


def _placed(path, table):
    """Return what poses a file's robot by yourdfpy and tells where its links are."""
    robot = library("yourdfpy").URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    assert robot.validate()

    def placed(angles):
        robot.update_cfg(angles)
        return lambda link: robot.get_transform(link, table.track.bone_names[0])[:3, 3]

    return placed


def mujoco(kind, folder):
    """MuJoCo's kinematics, from the joint states in the CSV beside."""
    library("mujoco")
    import mujoco as engine

    pandas = library("pandas")
    table, (path, states) = written(kind, "urdf", folder)
    robot = engine.MjModel.from_xml_path(str(path))
    data = engine.MjData(robot)
    assert robot.ngeom == len(table.model.ellipsoids["fine"].bone)  # it shows them

    def placed(angles):
        for name, angle in angles.items():
            data.joint(name).qpos[0] = angle
        engine.mj_forward(robot, data)
        return lambda link: data.body(link).xpos

    return _robot_error(placed, table, pandas.read_csv(states).to_dict("records"))


def _robot_error(placed, table, rows):
    """rows: joint states of the frames. placed: poses the robot by angles and returns where links are about its root."""
    track, found = table.track, []
    for row in rows:
        place = placed({name: row[name] for name in track.parameter_names[6:]})
        turn = Rotation.from_quat([row[f"root_q{axis}"] for axis in "xyzw"]).as_matrix()
        base = np.array([row[f"root_{axis}_m"] for axis in "xyz"])
        links = [f"{n}_point" if n in track.bone_names else n for n in track.joint_names]
        found.append([base + turn @ place(link) for link in links])
    wanted = track.joint_positions if len(rows) == len(track) else track.joint_positions[~table.is_lost]  # fmt: skip
    return _worst(np.array(found), wanted)


def mcap(kind, folder):
    """mcap's reader with its decoder of ROS 2 messages, into yourdfpy."""
    _, decoder = library("mcap"), library("mcap_ros2.reader")
    table, (path,) = written(kind, "mcap", folder)
    _, (robot_path, _) = written(kind, "urdf", folder)
    by_topic = defaultdict(list)
    for message in decoder.read_ros2_messages(str(path)):
        by_topic[message.channel.topic].append(message)
    (described,) = by_topic.pop("/robot_description")
    assert described.ros_msg.data == robot_path.read_text(encoding="utf-8")
    seen = np.flatnonzero(~table.is_lost)
    for messages in by_topic.values():
        assert [one.sequence_count for one in messages] == table.track.frame[seen].tolist()
    states, places = ([one.ros_msg for one in by_topic[t]] for t in ("/joint_states", "/root_pose"))
    moves = [moved for one in by_topic["/tf"] for moved in one.ros_msg.transforms]
    for stamped in (states, places, moves):
        stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in stamped]
        assert_allclose(stamps, table.track.time_s[seen], atol=1e-8)
    rows = []
    for state, place, move in zip(states, places, moves, strict=True):
        assert (move.header.frame_id, move.child_frame_id) == ("world", table.track.bone_names[0])
        row = dict(zip(state.name, state.position, strict=True))
        for axis in "xyz":
            row[f"root_{axis}_m"] = getattr(place.pose.position, axis)
            assert getattr(move.transform.translation, axis) == row[f"root_{axis}_m"]
        for axis in "xyzw":
            row[f"root_q{axis}"] = getattr(place.pose.orientation, axis)
            assert getattr(move.transform.rotation, axis) == row[f"root_q{axis}"]
        rows.append(row)
    return _robot_error(_placed(robot_path, table), table, rows)


def c3d(kind, folder):
    """The package c3d; the file is written by ezc3d."""
    library("ezc3d")
    reader_of = library("c3d")
    table, (path,) = written(kind, "c3d", folder)
    with path.open("rb") as file:
        reader = reader_of.Reader(file)
        assert tuple(label.strip() for label in reader.point_labels) == table.track.joint_names
        assert reader.point_rate == table.fps
        frames = [(number, points) for number, points, _ in reader.read_frames()]
    assert [number - 1 for number, _ in frames] == table.track.frame.tolist()
    points = np.array([rows for _, rows in frames])
    assert ((points[..., 3] >= 0).all(axis=1) == ~table.is_lost).all()
    return _worst_seen(1e-3 * points[..., :3], table)


def anipose(kind, folder):
    """pandas, by the columns that Anipose names (`movement` reads the same)."""
    pandas = library("pandas")
    table, (path,) = written(kind, "anipose", folder)
    rows = pandas.read_csv(path)
    assert rows["fnum"].tolist() == table.track.frame.tolist()
    points = np.stack(
        [rows[[f"{n}_x", f"{n}_y", f"{n}_z"]].to_numpy() for n in table.track.joint_names], axis=1
    )
    assert np.isnan(points[LOST_ROW]).all()
    scores = rows[[f"{n}_score" for n in table.track.joint_names]].to_numpy()
    assert ((scores > 0).all(axis=1) == ~table.is_lost).all()
    return _worst_seen(1e-3 * points, table)


def pose(kind, folder):
    """pose-format's reader: a component of points by MediaPipe's names, masked where the pose is lost."""
    Pose = library("pose_format").Pose
    table, (path,) = written(kind, "pose", folder)
    found = Pose.read(path.read_bytes())
    names = found.header.components[0].points
    ours, theirs = ("right_wrist",) * 2 if kind == "body" else ("index_dip", "index_finger_dip")
    places = found.body.data[:, 0, names.index(theirs.upper())]
    lost = np.ma.getmaskarray(places).all(axis=1)
    assert lost.tolist() == list(table.is_lost)
    assert found.body.fps == pytest.approx(50.0)
    wanted = table.track.joint_positions[:, table.track.joint_names.index(ours)]
    return _worst(np.asarray(places)[~lost] / 1e3, wanted[~lost])


def _ordered(name, kind, folder):
    """Python's json, by the order in OpenPose's or MediaPipe's documentation; a file a frame in a zip, numbered by it."""
    table, (path,) = written(kind, name, folder)
    if name == "openpose-files":
        with zipfile.ZipFile(path) as archive:
            numbers = [int(re.findall(r"\d{12}", file)[0]) for file in archive.namelist()]
            frames = [json.loads(archive.read(file)) for file in archive.namelist()]
        assert numbers == table.track.frame.tolist()
        names = json.loads(written(kind, "openpose", folder)[1][0].read_text())["names"]
    else:
        told = json.loads(path.read_text())
        frames, names = told["frames"], told["names"]
    joints = table.track.joint_names
    found, wanted = [], []
    for i, frame in enumerate(frames):
        if "people" in frame:
            threes = [[v for k, v in p.items() if k.endswith("_3d")] for p in frame["people"]]
            rows = [max(one, key=len) for one in threes]
        else:
            key = next(k for k in frame if k.endswith("world_landmarks"))
            rows = [
                [m["x"], m["y"], m["z"], m["visibility"]] for marks in frame[key] for m in marks
            ]
        marks = np.array(rows).reshape(-1, 4)
        assert (len(marks) == 0) == bool(table.is_lost[i])
        for mark, joint in zip(marks, names, strict=False):
            assert (mark[3] > 0) == (joint in joints)
            if joint in joints:
                found.append(mark[:3])
                wanted.append(table.track.joint_positions[i, joints.index(joint)])
    return _worst(np.array(found), np.array(wanted))


def glb(kind, folder):
    """pygltflib's arrays, posed here by the rules of glTF: vertices of one bone alone; trimesh loads the mesh."""
    pygltflib = library("pygltflib")
    import trimesh

    table, (path,) = written(kind, "glb", folder)
    scene = trimesh.load(path)
    file = pygltflib.GLTF2().load(str(path))
    blob = file.binary_blob()

    def array(number):
        told = file.accessors[number]
        view = file.bufferViews[told.bufferView]
        dtype = {5121: np.uint8, 5125: np.uint32, 5126: np.float32}[told.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[told.type]
        rows = np.frombuffer(blob, dtype, told.count * width, view.byteOffset)
        return rows.reshape(told.count, width).astype(float)

    (mesh,), (skin,), (animation,) = file.meshes, file.skins, file.animations
    attributes = mesh.primitives[0].attributes
    rest = array(attributes.POSITION)
    (loaded,) = scene.geometry.values()
    assert len(loaded.faces) == file.accessors[mesh.primitives[0].indices].count // 3
    joints, weights = array(attributes.JOINTS_0).astype(int), array(attributes.WEIGHTS_0)
    assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    ours = model_skin(table.model)
    rigid = (weights[:, 0] == 1) & (joints[:, 0] == ours.bone)
    assert 0.3 < rigid.mean() < 1  # bones' middles; at joints neighbours have a share
    back = array(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    above = {child: n for n, node in enumerate(file.nodes) for child in node.children or ()}
    moves = {
        (c.target.node, c.target.path): array(animation.samplers[c.sampler].output)
        for c in animation.channels
    }
    times = array(animation.samplers[0].input)[:, 0]
    assert_allclose(times, table.track.time_s - table.track.time_s[0], atol=1e-6)
    poses = {}
    for n in skin.joints:  # parents come first
        node, pose = file.nodes[n], np.tile(np.eye(4), (len(times), 1, 1))
        turn = moves.get((n, "rotation"), [node.rotation])
        pose[:, :3, :3] = Rotation.from_quat(turn).as_matrix()
        pose[:, :3, 3] = moves.get((n, "translation"), node.translation)
        poses[n] = poses[above[n]] @ pose if n in above else pose

    def carried(poses, points):
        """Return all points (V, 3), carried by the pose of each one's bone."""
        mine = poses[:, ours.bone]
        return np.einsum("fvij,vj->fvi", mine[..., :3, :3], points) + mine[..., :3, 3]

    found = carried(np.stack([poses[n] for n in skin.joints], axis=1) @ back, rest)
    wanted = carried(table.track.T_world_bone, ours.local)
    return _worst(found[:, rigid], wanted[:, rigid])


def netcdf(kind, folder):
    """xarray, by labels."""
    xarray = library("xarray")
    table, (path,) = written(kind, "netcdf", folder)
    track = table.track
    with xarray.open_dataset(path) as data:
        assert [str(name) for name in data["keypoints"].values] == list(track.joint_names)
        assert data.attrs["fps"] == table.fps
        assert data["position"].attrs["units"] == "m"
        place = data["position"].transpose("time", "keypoints", "space", "individuals")[..., 0]
        assert np.isnan(place.values[LOST_ROW]).all()
        first = data["angle"].sel(parameter=track.parameter_names[6]).values
        assert_array_equal(first, track.parameters[:, 6])
        assert str(data["reason"].values[LOST_ROW]) == str(track.reason[LOST_ROW])
        return _worst_seen(place.values, table)


def nwb(kind, folder):
    """pynwb, by ndx-pose's types."""
    pynwb, _ = library("pynwb"), library("ndx_pose")
    table, (path,) = written(kind, "nwb", folder)
    with pynwb.NWBHDF5IO(str(path), "r") as reader:
        file = reader.read()
        assert file.session_id.endswith(f"-{table.track.frame[-1]}")
        module = file.processing["behavior"]
        estimate = module["PoseEstimation"]
        rows = [estimate.pose_estimation_series[name] for name in table.track.joint_names]
        points = np.stack([row.data[:] for row in rows], axis=1)
        assert (rows[0].confidence[LOST_ROW], rows[0].unit) == (0.0, "meters")
        times = rows[0].starting_time + np.arange(len(points)) / rows[0].rate
        assert_allclose(times, table.track.time_s)
        written_ = [module[f"parameters_{unit}"] for unit in ("meters", "radians")]
        values = np.concatenate([one.data[:] for one in written_], axis=1)
        assert_allclose(values[~table.is_lost], table.track.parameters[~table.is_lost])
        links = estimate.skeleton.edges[:]
        assert len(links) >= len(rows) - 2
    return _worst_seen(points, table)


READERS: dict[str, Callable[[str, Path], float]] = {
    "glb": glb, "trc": trc, "mot": mot, "bvh": bvh, "urdf": urdf, "urdf in MuJoCo": mujoco, "mcap": mcap, "c3d": c3d,
    "netcdf": netcdf, "nwb": nwb, "anipose": anipose, "openpose": partial(_ordered, "openpose"), "openpose-files": partial(_ordered, "openpose-files"), "pose": pose, "mediapipe": partial(_ordered, "mediapipe"),
}  # fmt: skip


def worst_errors(folder: Path) -> dict[str, float]:
    """Return each reader's largest error over all kinds of skeletons [mm]."""
    return {
        f"{re.sub('[ -]', '_', name)}_mm": max(
            read(kind, folder) for kind in KINDS if name not in OF_KNOWN_SKELETONS or kind != "claw"
        )
        for name, read in READERS.items()
    }


def main() -> None:
    """Print the errors as JSON."""
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(worst_errors(Path(folder))))


if __name__ == "__main__":
    main()
