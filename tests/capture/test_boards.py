"""Boards: their texts, prints in true size, and what is found of them in images."""

import re
import struct

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.board_detection import find_board
from handtrack.capture.calibration.board_printing import draw_board, page_size_mm, write_board
from handtrack.capture.calibration.boards import CharucoBoard, Chessboard, parse_board

CHARUCO = "charuco:7x5:30mm:22mm:DICT_4X4_50"
MARGIN_MM = 15.0  # of the CHARUCO print: half a square


def test_a_board_is_one_text():
    assert parse_board("chessboard:9x6:25mm") == Chessboard(9, 6, 0.025)
    assert parse_board(CHARUCO) == CharucoBoard(7, 5, 0.03, 0.022, "DICT_4X4_50")
    for text in ("chessboard:9x6:25mm", CHARUCO, "chessboard:4x7:12.5mm"):
        assert parse_board(text).text == text
    assert parse_board("chessboard:9x6:2.5cm") == parse_board("chessboard:9x6:0.025m")


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
