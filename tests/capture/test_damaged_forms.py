"""Damaged and hostile files of every form."""

from contextlib import suppress

import cv2
import numpy as np
import pytest

import handtrack.capture.images.video as video_module
from handtrack import HandtrackError
from handtrack.capture.calibration.formats.read_calibration import (
    named,
    read_calibration,
    sized,
    unit_of,
)
from handtrack.capture.images.containers import CAPTURE_OPTIONS
from handtrack.capture.images.video import VideoFile
from handtrack.capture.joints.read_joints import read_joints
from handtrack.session.truth import import_truth
from tests.capture.sample_files import filmed, forms, sample
from tests.conftest import refused

_TIMES = 12
_PIECES = [
    b"nan",
    b"1e400",
    b"-",
    b"[",
    b"{",
    b'"',
    b"\n",
    b":",
    b",",
    b"null",
    b"9" * 20,
    b"\0",
    b"<a>",
    b"- ",
]


def damaged(data, rng):
    """Return bytes with some changed, taken out, put in or repeated, or the end cut off."""
    for _ in range(rng.choice([1, 1, 2, 5])):
        at = int(rng.integers(max(len(data), 1)))
        end = at + int(rng.choice([0, 1, 3, 20, 200]))
        pieces = bytes([rng.integers(256)]), rng.choice(_PIECES), data[at:end] * 2, b""
        rest = data[end:] if rng.random() < 0.9 else b""
        data = data[:at] + pieces[rng.integers(4)] + rest
    return data


def settled(paths):
    given, _ = sized(
        named(read_calibration(paths), ["cam0", "cam1"], "it")[0], {"cam0": (640, 480)}, "it"
    )
    return given.rig(unit_of(given).unit_m or 1.0)


READ = {
    "calibration": settled,
    "hands": lambda paths: read_joints(str(paths[0]), "it").hand("right", "it"),
    "bodies": lambda paths: read_joints(str(paths[0]), "it"),
    "truth": lambda paths: import_truth(paths[0], "right"),
}
WHOLE = [
    form for kind in READ for form in forms(kind) if "fisheye" not in form and "inch" not in form
]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("form", WHOLE)
def test_a_damaged_file_is_refused_or_read(form, tmp_path):
    paths = sample(form, tmp_path)
    read, rng = READ[form.split("/")[0]], np.random.default_rng(7)
    files = [file for path in paths for file in (path, *sorted(path.rglob("*"))) if file.is_file()]
    for _ in range(_TIMES):
        file = files[rng.integers(len(files))]
        whole = file.read_bytes()
        file.write_bytes(damaged(whole, rng))
        with suppress(HandtrackError):
            read(paths)
        file.write_bytes(whole)
    read(paths)


MADE = {
    "a.mp4": "mp4v", "a.mov": "mp4v", "a.3gp": "mp4v", "a.avi": "MJPG", "a.mkv": "mp4v", "a.webm": "VP80", "a.mpg": "mpg1", "a.m2ts": "mp4v",
    "a.flv": "FLV1", "a.wmv": "WMV2", "a.mjpeg": "MJPG", "a.ivf": "VP80", "a.mxf": "mpg2", "a.y4m": "I420",
}  # fmt: skip
PLAYLISTS = {
    "hls.m3u8": "#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{other}\n#EXT-X-ENDLIST\n",
    "endless.m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{other}\n",
    "renamed.mp4": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{other}\n#EXT-X-ENDLIST\n",
    "concat.ffconcat": "ffconcat version 1.0\nfile {other}\n",
    "beside.ffconcat": "ffconcat version 1.0\nfile a.mp4\n",
    "session.sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    "dash.mpd": '<?xml version="1.0"?><MPD profiles="urn:mpeg:dash:profile:isoff-on-demand:2011" type="static">'
    '<Period><AdaptationSet mimeType="video/mp4"><Representation id="1" bandwidth="1"><BaseURL>{other}</BaseURL>'
    "</Representation></AdaptationSet></Period></MPD>",
    "list.asx": '<asx version="3.0"><entry><ref href="{other}"/></entry></asx>',
    "list.pls": "[playlist]\nFile1={other}\n",
    "script.avs": 'DirectShowSource("{other}")\n',
    "imf.xml": '<?xml version="1.0"?><CompositionPlaylist xmlns="http://www.smpte-ra.org/schemas/2067-3/2013"/>',
}


def write_video(path, code="mp4v"):
    return filmed(path, (np.full((48, 64, 3), 40 * n, np.uint8) for n in range(5)), code)


@pytest.mark.parametrize("name", MADE)
def test_containers_that_people_have_are_opened_also_by_our_programs(name, tmp_path, monkeypatch):
    path = write_video(tmp_path / name, MADE[name])
    if not path.exists() or not cv2.VideoCapture(str(path)).isOpened():
        pytest.skip("this OpenCV writes no such file")
    VideoFile(path).read(3)
    monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", CAPTURE_OPTIONS)
    assert VideoFile(path).read(3) is not None


@pytest.mark.parametrize("name", PLAYLISTS)
def test_nothing_that_names_other_files_is_opened(name, tmp_path, monkeypatch):
    (tmp_path / "session").mkdir()
    write_video(tmp_path / "session/a.mp4")
    playlist, other = tmp_path / "session" / name, write_video(tmp_path / "secret.mp4")
    playlist.write_text(PLAYLISTS[name].replace("{other}", str(other)))
    monkeypatch.setattr(cv2, "VideoCapture", None)  # OpenCV does not get to see it
    refused(name, VideoFile, playlist)


def test_opening_ends_in_time(tmp_path, monkeypatch):
    """FFmpeg looks for a beginning in 8 TB of zeros."""
    monkeypatch.setattr(video_module, "_OPEN_MS", 200)
    path = write_video(tmp_path / "a.mkv")
    path.write_bytes(path.read_bytes()[:40])
    with path.open("r+b") as file:
        file.truncate(8 << 40)
    refused("cannot be opened", VideoFile, path)
