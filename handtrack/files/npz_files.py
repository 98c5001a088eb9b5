"""Arrays in .npz files: read in one place, without pickles, and without believing what a header announces."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.errors import HandtrackError

_MOST_BYTES = 2 << 30  # of one array: ninety million points, seven hours of tracked frames
_SMALL_BYTES = 256 << 20  # of a whole file that may be packed as tightly as can be
_TIGHTEST = 100  # times its size on disk, of a larger one: numbers that were measured pack 20 times
_ENDING = ".npy"


def read_arrays(path: Path) -> dict[str, Array[*Axes]]:
    """Return the arrays of an .npz by their names. Raises HandtrackError for whatever is no .npz of plain arrays."""
    try:
        with zipfile.ZipFile(path) as archive:
            _check_total(archive, path)
            return {
                entry.filename.removesuffix(_ENDING): _array(archive, entry, path)
                for entry in archive.infolist()
                if entry.filename.endswith(_ENDING)
            }
    except FileNotFoundError:
        raise HandtrackError(f"{path}: no such file.") from None
    except IsADirectoryError:
        raise HandtrackError(f"{path} is a folder; expected an .npz file.") from None
    except (HandtrackError, MemoryError):
        raise
    except (
        Exception
    ) as error:  # zipfile, zlib and numpy's parser of headers fail in many ways on damaged bytes
        raise HandtrackError(
            f"{path}: not a readable .npz of plain arrays ({error}). Was it cut off while it was written or copied, or is "
            "it another kind of file?"
        ) from None


def _check_total(archive: zipfile.ZipFile, path: Path) -> None:
    """Raise HandtrackError for a file that is small on disk and huge in memory; nothing of it is unpacked."""
    size, packed = sum(entry.file_size for entry in archive.infolist()), path.stat().st_size
    if size > max(_SMALL_BYTES, _TIGHTEST * packed):
        raise HandtrackError(
            f"{path}: {packed / 1e6:.3g} MB on disk that would take {size / 1e9:.2g} GB of memory; expected at most "
            f"{_TIGHTEST} times its size. Was it made to fill the memory? If its numbers really are all alike, save it "
            "with numpy.savez, not packed."
        )


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path) -> Array:
    with archive.open(entry) as file:
        shape, dtype = _announced(file)
        size = math.prod(shape) * dtype.itemsize
        name = entry.filename.removesuffix(_ENDING)
        if size > _MOST_BYTES:
            raise HandtrackError(
                f"{path}: `{name}` would take {size / 1e9:.0f} GB of memory (shape {shape} of {dtype}); expected at most "
                f"{_MOST_BYTES / 1e9:.0f} GB. Split it, or thin it."
            )
        told = file.tell() + size
        if told > entry.file_size:
            raise ValueError(f"`{name}` is cut off")
        if told < entry.file_size and not dtype.hasobject:  # those numpy refuses, unread
            raise ValueError(
                f"`{name}` holds more bytes than its shape {shape} of {dtype} explains"
            )
    with archive.open(entry) as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        file.read(1)  # there is none: only at the end are the bytes checked
        return array


def _announced(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    version = np.lib.format.read_magic(file)
    first, second = np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0
    shape, _, dtype = first(file) if version == (1, 0) else second(file)
    return shape, dtype
