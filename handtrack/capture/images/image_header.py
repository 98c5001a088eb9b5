"""How large an image file says it is, from its first bytes: known before its pixels are unpacked."""

from __future__ import annotations

import re
import struct

_PNM = re.compile(rb"P[1-6](?:\s+|#[^\n]*\n)+(\d+)(?:\s+|#[^\n]*\n)+(\d+)\s")
_NO_FRAME = (0xC4, 0xC8, 0xCC)  # of JPEG's markers C0 to CF, those that begin no picture
_TIFF_SIDES = {256: 0, 257: 1}  # tags of width and height


def announced_size(data: bytes) -> tuple[int, int] | None:
    """Return width, height [px] as an image file announces them; None of files that say it in no way known here."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8\xff"):
            return _of_jpeg(data)
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return width, abs(height)  # negative: from the top down
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _of_tiff(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _of_webp(data)
        if b"ihdr" in data[:256]:  # JPEG 2000
            height, width = struct.unpack_from(">II", data, data.index(b"ihdr") + 4)
            return width, height
    except (struct.error, IndexError):  # cut off
        return None
    found = _PNM.match(data[:256])
    return (int(found[1]), int(found[2])) if found else None


def _of_jpeg(data: bytes) -> tuple[int, int]:
    at = 2
    while True:
        kind = data[at + 1]
        if kind == 0xFF:  # filling
            at += 1
        elif 0xC0 <= kind <= 0xCF and kind not in _NO_FRAME:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        else:
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]


def _of_tiff(data: bytes) -> tuple[int, int] | None:
    order = "<" if data.startswith(b"II") else ">"
    at = struct.unpack_from(f"{order}I", data, 4)[0]
    sides = [0, 0]
    for entry in range(struct.unpack_from(f"{order}H", data, at)[0]):
        tag, kind = struct.unpack_from(f"{order}HH", data, at + 2 + 12 * entry)
        if tag in _TIFF_SIDES:
            value = f"{order}{'H' if kind == 3 else 'I'}"
            sides[_TIFF_SIDES[tag]] = struct.unpack_from(value, data, at + 10 + 12 * entry)[0]
    return (sides[0], sides[1]) if all(sides) else None


def _of_webp(data: bytes) -> tuple[int, int] | None:
    kind = data[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
        return width, height
    if kind == b"VP8L":
        bits = struct.unpack_from("<I", data, 21)[0]
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
