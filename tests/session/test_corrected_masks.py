"""Files of corrections: they win over methods and files, also headless; what was there before is kept; odd ones are refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.masks.background import BackgroundMedian
from handtrack.capture.masks.mask_correction import AS_IT_IS, HAND, empty_layer, painted
from handtrack.capture.masks.seeded import UNKNOWN_LEVEL, Seeded
from handtrack.capture.masks.segmentation import SkinYCrCb
from handtrack.errors import HandtrackError
from handtrack.files.versions import versions
from handtrack.session.seen.corrected_masks import encoded
from handtrack.session.seen.views import View
from handtrack.session.session import Session
from tests.capture.seeded_scenes import SIZE
from tests.session.test_seeded_session import JOINTS, folder, opened

__all__ = ["folder"]
SKIN = '{ method = "skin_ycrcb" }'


def stroke(level: int = HAND) -> np.ndarray:
    return painted(empty_layer(SIZE), np.array([[30.0, 30], [60, 30]]), 8.0, level)


def write(folder: Path, image: np.ndarray, frame: int = 2) -> Path:
    path = folder / "masks_corrected" / "cam0" / f"{frame:06d}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("method", [SKIN, '{ method = "seeded" }', '"masks/*.png"'])
def test_a_correction_wins_where_it_says_something(folder: Path, method: str) -> None:
    (folder / "masks").mkdir()
    for frame in range(3):
        cv2.imwrite(str(folder / "masks" / f"{frame}.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    layer = stroke()
    layer[200:, :] = UNKNOWN_LEVEL
    write(folder, layer)
    session = opened(folder, method, JOINTS)
    view = session.view("cam0")
    own, (seen,) = view.given_mask(2), session.observation(2).silhouettes
    assert own is not None
    assert (seen.mask[layer == HAND] == 1).all()
    assert (seen.mask[layer == UNKNOWN_LEVEL] == -1).all()
    stays = layer == AS_IT_IS
    assert (((own == 255) == (seen.mask == 1))[stays]).all()
    np.testing.assert_array_equal(view.mask(1), view.given_mask(1))
    assert view.corrections.frames == [2]


def test_a_camera_without_masks_has_what_was_painted(folder: Path) -> None:
    write(folder, stroke())
    (folder / "session.toml").write_text(
        "[session]\nformat = 1\nfps = 10\n[[camera]]\nname = 'cam0'\nimages = 'cam0/*.png'\n"
    )
    session = Session.open(folder)
    (seen,) = session.observation(2).silhouettes
    assert {-1.0, 1.0} == set(np.unique(seen.mask).tolist())
    assert session.observation(1).silhouettes == ()


def test_what_is_held_comes_before_the_file_and_old_files_are_kept(folder: Path) -> None:
    theirs = write(folder, stroke(0))
    session = opened(folder, SKIN)
    corrections = session.view("cam0").corrections
    before, after = corrections.content(2), encoded(stroke())
    corrections.hold(2, after)
    session.look_again()
    (seen,) = session.observation(2).silhouettes
    assert seen.mask[30, 40] == 1
    assert theirs.read_bytes() == before
    corrections.write(2, after, None)
    assert theirs.read_bytes() == after
    (kept,) = versions(theirs)
    assert kept.read_bytes() == before
    corrections.write(2, None, after)  # what was made here needs no copy
    assert not theirs.exists()
    assert len(versions(theirs)) == 1
    corrections.hold(2, None)
    assert corrections.frames == []


@pytest.mark.parametrize(
    ("image", "found"),
    [
        (np.full((SIZE[1], SIZE[0]), 77, np.uint8), "found the level 77"),
        (np.zeros((20, 30), np.uint8), r"found an image \(20, 30\)"),
        (np.zeros((SIZE[1], SIZE[0]), np.uint16), r"found an image .* of uint16"),
    ],
)
def test_what_is_no_correction_is_refused(folder: Path, image: np.ndarray, found: str) -> None:
    write(folder, image)
    session = opened(folder, SKIN)
    with pytest.raises(HandtrackError, match=rf"masks_corrected/cam0/000002\.png: {found}"):
        session.observation(2)


def test_a_folder_that_leads_out_of_the_session_is_refused(folder: Path, tmp_path: Path) -> None:
    away = tmp_path.parent / f"{tmp_path.name}_away"
    away.mkdir()
    (folder / "masks_corrected").symlink_to(away)
    with pytest.raises(HandtrackError, match="leaves the session folder"):
        opened(folder, SKIN)


def test_masks_are_tried_without_touching_the_session(folder: Path) -> None:
    session = opened(folder, SKIN, JOINTS)
    said = (folder / "session.toml").read_text()
    dark = SkinYCrCb(y_min=255)
    changed = session.with_masks({"cam0": (dark, (10, 20, 200, 150))})
    (seen,), (usual,) = changed.observation(2).silhouettes, session.observation(2).silhouettes
    assert not seen.mask.any()
    assert usual.mask.any()
    assert seen.valid[0].tolist() == [0, 0]
    assert changed.file.cameras[0].masks == dark
    assert changed.view("cam0").images is session.view("cam0").images
    seeded = changed.with_masks({"cam0": (Seeded(sure=0.8), None)})
    assert seeded.observation(2).silhouettes[0].mask.min() == -1
    assert (folder / "session.toml").read_text() == said
    with pytest.raises(HandtrackError, match="reaches outside the image"):
        session.with_masks({"cam0": (dark, (10, 20, 2000, 150))})


def test_other_thresholds_are_learned_from_the_same_images(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = opened(folder, SKIN)
    tried = session.with_masks({"cam0": (BackgroundMedian(samples=5), None)})
    first = tried.observation(2).silhouettes[0].mask
    read = list[int]()
    files = session.view("cam0").images
    assert files is not None
    usual = type(files).read
    monkeypatch.setattr(type(files), "read", lambda f, n: read.append(n) or usual(f, n))
    again = tried.with_masks({"cam0": (BackgroundMedian(samples=5, threshold=30.0), None)})
    assert (again.observation(2).silhouettes[0].mask != first).any()
    assert read == [2]


def test_corrections_of_a_recording_are_none_of_a_running_camera(folder: Path) -> None:
    write(folder, stroke())
    recorded = opened(folder, SKIN).view("cam0")
    assert recorded.images is not None
    running = View(folder, recorded.settings, recorded.camera, live=recorded.images)
    assert running.corrections.frames == []
    np.testing.assert_array_equal(running.mask(2), recorded.given_mask(2))
