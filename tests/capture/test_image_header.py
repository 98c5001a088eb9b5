"""Image files announce their size, and one that is too large is refused before its pixels are unpacked."""

import cv2
import numpy as np
import pytest

from handtrack.capture.images.frames import ImageFiles, announced_size
from handtrack.errors import HandtrackError

KINDS = [".png", ".jpg", ".bmp", ".tif", ".webp", ".ppm", ".pgm", ".jp2"]
WIDTH, HEIGHT = 300, 200


def encoded(kind: str, *options: int) -> bytes:
    shape = (HEIGHT, WIDTH) if kind == ".pgm" else (HEIGHT, WIDTH, 3)
    picture = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    done, data = cv2.imencode(kind, picture, options)
    assert done
    return data.tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_the_size_is_in_the_first_bytes(kind):
    assert announced_size(encoded(kind)) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("kind", KINDS)
def test_c15_an_image_larger_than_its_camera_is_not_unpacked(kind, tmp_path, monkeypatch):
    (tmp_path / f"0{kind}").write_bytes(encoded(kind))
    files = ImageFiles([tmp_path / f"0{kind}"], expected_size=(299, 200))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was unpacked"))
    with pytest.raises(
        HandtrackError, match="300 x 200, but the camera is calibrated for 299 x 200"
    ):
        files.read(0)
