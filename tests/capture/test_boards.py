"""Boards: their texts, prints in true size, and what is found of them in images."""

from __future__ import annotations

import re
import struct

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.board_detection import find_board
from handtrack.capture.calibration.board_printing import draw_board, page_size_mm, write_board
from handtrack.capture.calibration.boards import CharucoBoard, Chessboard, parse_board
from handtrack.errors import HandtrackError

CHARUCO = "charuco:7x5:30mm:22mm:DICT_4X4_50"
MARGIN_MM = 15.0  # of the CHARUCO print: half a square


def test_a_board_is_one_text():
    assert parse_board("chessboard:9x6:25mm") == Chessboard(9, 6, 0.025)
    assert parse_board(CHARUCO) == CharucoBoard(7, 5, 0.03, 0.022, "DICT_4X4_50")
    for text in ("chessboard:9x6:25mm", CHARUCO, "chessboard:4x7:12.5mm"):
        assert parse_board(text).text == text
    assert parse_board("chessboard:9x6:2.5cm") == parse_board("chessboard:9x6:0.025m")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("9x6", "board '9x6': expected chessboard:9x6:25mm (inner corners) or charuco"),
        ("chessboard:9x6:25", "'25' is no length; expected a number with its unit, such as 25mm."),
        ("chessboard:9by6:25mm", "'9by6' is no size"),
        ("chessboard:2x6:25mm", "2 x 6; expected 3 to 60 of them along each side."),
        ("chessboard:9x6:25m", "a side of 25000 mm; expected 1 mm to 2 m. Is the unit right?"),
        ("charuco:7x5:22mm:30mm:DICT_4X4_50", "the marker (30 mm) must be smaller than its square"),
        ("charuco:7x5:30mm:22mm:DICT_9X9", "no marker dictionary 'DICT_9X9'"),
        ("charuco:30x20:30mm:22mm:DICT_4X4_50", "it needs 300 markers, DICT_4X4_50 has 50"),
    ],
)
def test_a_wrong_text_is_refused_in_words(text, message):
    with pytest.raises(HandtrackError, match=re.escape(message)):
        parse_board(text)


@pytest.mark.parametrize(
    ("text", "ways"),
    [("9x6", 1), ("4x7", 1), ("8x6", 2), ("7x5", 2), ("6x6", 4), ("5x5", 2)],
)
def test_ways_in_which_a_board_looks_the_same(text, ways):
    """One even and one odd count tell a board's direction; two of a kind do not."""
    board = parse_board(f"chessboard:{text}:25mm")
    assert len(board.turns) == ways
    # each renumbering is a turn of the points about the board's middle
    points = board.points[:, :2] - board.points[:, :2].mean(axis=0)
    for turn in board.turns:
        assert np.allclose(np.linalg.norm(points[turn], axis=1), np.linalg.norm(points, axis=1))


@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", "chessboard:8x6:20mm", CHARUCO])
def test_what_is_printed_is_found_where_it_was_printed(text):
    board = parse_board(text)
    view = find_board(draw_board(board, 3.0), board)
    assert len(view.ids) == len(board.points)
    expected = board.points[view.ids, :2] * 3e3
    off = view.pixels - view.pixels[0] - (expected - expected[0])
    assert np.abs(off).max() < 0.05
    if isinstance(board, CharucoBoard):  # also in OpenCV 4, whose own corners are half a pixel off
        assert np.allclose(view.pixels, expected + 3 * MARGIN_MM - 0.5, atol=0.05)


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
def test_corners_keep_their_numbers_when_the_board_is_turned(quarter_turns):
    board = parse_board("chessboard:7x4:25mm")
    page = draw_board(board, 2.0)
    upright = find_board(page, board)
    turned = find_board(np.ascontiguousarray(np.rot90(page, quarter_turns)), board)
    height, width = page.shape
    x, y = upright.pixels.T
    expected = {1: (y, width - 1 - x), 2: (width - 1 - x, height - 1 - y), 3: (height - 1 - y, x)}
    assert np.allclose(turned.pixels, np.stack(expected[quarter_turns], -1), atol=0.1)


def test_a_part_of_a_charuco_board_is_enough():
    board = parse_board(CHARUCO)
    page = draw_board(board, 3.0)
    page[:, : page.shape[1] // 2] = 128
    view = find_board(page, board)
    assert 8 <= len(view.ids) < len(board.points)


def test_no_board_is_none():
    noise = np.random.default_rng(7).integers(0, 255, (240, 320)).astype(np.uint8)
    for text in ("chessboard:9x6:25mm", CHARUCO):
        assert find_board(noise, parse_board(text)) is None


def test_squares_beyond_the_edge_are_noticed():
    """A detector may find 8 x 6 corners of a 9 x 6 board; that must not pass for an 8 x 6 one."""
    page = draw_board(parse_board("chessboard:9x6:25mm"), 2.0)
    right = find_board(page, parse_board("chessboard:9x6:25mm"))
    part = find_board(page, parse_board("chessboard:8x6:25mm"), thorough=True)
    assert not right.goes_on
    assert part is None or part.goes_on


def test_blur_is_measured_in_pixels():
    board = parse_board("chessboard:9x6:25mm")
    page = draw_board(board, 2.0)
    widths = [find_board(cv2.GaussianBlur(page, (0, 0), s), board).blur_px for s in (0.8, 1.6, 3.2)]
    # the edge of a Gaussian blur has ∫ |∇|² = C² / (2 √π σ)
    assert np.allclose(widths, 2 * np.sqrt(np.pi) * np.array([0.8, 1.6, 3.2]), rtol=0.2)


@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", CHARUCO])
def test_prints_state_their_true_size(tmp_path, text):
    board = parse_board(text)
    width, height = page_size_mm(board)
    for suffix in ("svg", "pdf", "png"):
        assert write_board(tmp_path / f"b.{suffix}", board, dpi=254.0) == (width, height)
    svg = (tmp_path / "b.svg").read_text()
    assert f'width="{width:g}mm" height="{height:g}mm" viewBox="0 0 {width:g} {height:g}"' in svg
    pdf = (tmp_path / "b.pdf").read_bytes()
    box = [float(v) for v in re.search(rb"MediaBox \[0 0 (\S+) (\S+)\]", pdf).groups()]
    assert np.allclose(box, np.array([width, height]) / 25.4 * 72, atol=1e-3)
    assert pdf[int(pdf.split(b"startxref\n")[1].split()[0]) :].startswith(b"xref")
    png = (tmp_path / "b.png").read_bytes()
    at = png.index(b"pHYs") + 4
    assert struct.unpack(">IIB", png[at : at + 9]) == (10000, 10000, 1)
    assert cv2.imdecode(np.frombuffer(png, np.uint8), 0).shape == (
        round(height * 10),
        round(width * 10),
    )


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(HandtrackError, match=r"a board is written as \.svg, \.pdf, \.png"):
        write_board(tmp_path / "b.bmp", parse_board(CHARUCO))
