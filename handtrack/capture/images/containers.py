"""The video files that are opened, known by their first bytes: none of them makes FFmpeg read another file.

FFmpeg chooses what reads a file by content and name, and some of its readers follow what the file says to other files and servers:
playlists (HLS, DASH, concat, SDP), and names with a number in them, which stand for a series of images.
"""

from __future__ import annotations

import re
from pathlib import Path

from handtrack.errors import HandtrackError
from handtrack.files.text_files import first_bytes

_CONTAINERS = {
    "mov": rb".{4}(ftyp|moov|mdat|wide|free|skip|pnot)",
    "matroska": rb"\x1aE\xdf\xa3",
    "avi": rb"RIFF.{4}AVI",
    "mpegts": rb"G.{187}G.{187}G|.{4}G.{191}G.{191}G",  # packets of 188 bytes, or 192 with their times
    "mpeg,mpegvideo,m4v,h264,hevc": rb"\x00?\x00\x00\x01",
    "asf": rb"0&\xb2u\x8ef\xcf\x11",
    "flv": rb"FLV\x01",
    "ogg": rb"OggS",
    "gif": rb"GIF8[79]a",
    "yuv4mpegpipe": rb"YUV4MPEG2 ",
    "mjpeg": rb"\xff\xd8\xff",
    "mxf": rb"\x06\x0e\x2b\x34",
    "ivf": rb"DKIF",
    "dv": rb"\x1f\x07\x00",
    "cine": rb"CI\x2c\x00",  # of high-speed cameras
}
"""by FFmpeg's readers of it"""
_KNOWN = re.compile(b"|".join(_CONTAINERS.values()), re.DOTALL)
_SERIES = re.compile(r"%\d*d")

CAPTURE_OPTIONS = f"protocol_whitelist;file|format_whitelist;{','.join(_CONTAINERS)}"
"""value of OPENCV_FFMPEG_CAPTURE_OPTIONS, by which FFmpeg itself refuses all others; our own programs set it"""


def check_container(path: Path, where: str) -> None:
    """Raise HandtrackError unless a path is a file of a container that is opened."""
    if not path.is_file():
        there = "a folder, a pipe or a device" if path.exists() else "no such file"
        raise HandtrackError(f"{where}: {there}; expected a video.")
    if _SERIES.search(str(path.absolute())):
        raise HandtrackError(
            f"{where}: a video's path must not hold '%d', which stands for a series of images. Rename it."
        )
    begins = first_bytes(path)
    if not _KNOWN.match(begins):
        raise HandtrackError(
            f"{where}: cannot be opened as a video. It begins with {begins[:12]!r}, as no known video file does; expected MP4, "
            "MOV, AVI, MKV, WebM, MPEG, WMV, FLV, OGG, GIF, Y4M, MXF, DV or Cine. Playlists are not followed: give the video "
            "that they name, or re-encode it (for instance with ffmpeg)."
        )
