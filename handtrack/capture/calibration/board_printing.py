"""Boards to print, in their true size: SVG and PDF as exact rectangles, PNG with its resolution."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from handtrack.arrays import D4, Bytes, Floats, H, R, W
from handtrack.capture.calibration.boards import Board, CharucoBoard
from handtrack.errors import HandtrackError

FORMATS = (".svg", ".pdf", ".png")
_MARGIN_MM = 12.0  # white around the squares: detectors need it, and the line of text stands in it
_POINT_MM = 25.4 / 72
_TEXT_MM = 3.5


def write_board(path: Path, board: Board, dpi: float = 300.0) -> tuple[float, float]:
    """Write a board to an SVG, PDF or PNG file in true size; return the page's size (w, h) [mm].

    dpi: of a PNG, whose edges are shaded to a quarter of a pixel; SVG and PDF are exact.
    """
    writers = {".svg": _svg, ".pdf": _pdf, ".png": lambda b: _png(b, dpi)}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise HandtrackError(
            f"--out {path}: a board is written as {', '.join(FORMATS)}; found the suffix "
            f"'{path.suffix}'."
        )
    path.write_bytes(writer(board))
    return page_size_mm(board)


def page_size_mm(board: Board) -> tuple[float, float]:
    """Return width and height of the drawing with its margin [mm]."""
    square = board.square_m * 1e3
    margin = _margin_mm(board)
    width, height = board.squares
    return width * square + 2 * margin, height * square + 2 * margin


def black_rectangles(board: Board) -> Floats[R, D4]:
    """Return x, y, width, height [mm] of what is black, from the page's upper left corner."""
    square, margin = board.square_m * 1e3, _margin_mm(board)
    columns, rows = board.squares
    cells = [
        (margin + c * square, margin + r * square, square, square)
        for r in range(rows)
        for c in range(columns)
        if (r + c) % 2 == 0
    ]
    if isinstance(board, CharucoBoard):
        cells += _marker_rectangles(board, margin)
    return np.array(cells)


def draw_board(board: Board, pixels_per_mm: float) -> Bytes[H, W]:
    """Return the page uint8 at a resolution; edges inside a pixel are shaded."""
    fine = 4  # sub-pixels along each side
    width, height = (round(side * pixels_per_mm) for side in page_size_mm(board))
    page = np.full((height * fine, width * fine), 255, np.uint8)
    for x, y, w, h in black_rectangles(board) * pixels_per_mm * fine:
        page[round(y) : round(y + h), round(x) : round(x + w)] = 0
    return page.reshape(height, fine, width, fine).mean(axis=(1, 3)).round().astype(np.uint8)


def _margin_mm(board: Board) -> float:
    return max(_MARGIN_MM, 0.5 * board.square_m * 1e3)


def _marker_rectangles(board: CharucoBoard, margin: float) -> list[tuple[float, ...]]:
    """Return the black bits of all markers, neighbours in a row joined so that no hair lines show."""
    found: list[tuple[float, ...]] = []
    dictionary = board.cv2_dictionary
    modules = dictionary.markerSize + 2
    bit = board.marker_m * 1e3 / modules
    corners = [np.array(c, float).reshape(4, 3) for c in board.cv2_board.getObjPoints()]
    for number, corner in zip(board.cv2_board.getIds().reshape(-1), corners, strict=True):
        black = cv2.aruco.generateImageMarker(dictionary, int(number), modules) < 128
        left, top = corner[:, :2].min(axis=0) * 1e3 + margin
        for r, row in enumerate(black):
            edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(int), [0]])))
            for start, end in edges.reshape(-1, 2):
                found.append((left + start * bit, top + r * bit, (end - start) * bit, bit))
    return found


def _caption(board: Board) -> str:
    width, height = (n * board.square_m * 1e3 for n in board.squares)
    return f"{board.text}   black and white squares together {width:g} x {height:g} mm: measure after printing at 100 %"


def _svg(board: Board) -> bytes:
    width, height = page_size_mm(board)
    rectangles = "\n".join(
        f'<rect x="{x:.6g}" y="{y:.6g}" width="{w:.6g}" height="{h:.6g}"/>'
        for x, y, w, h in black_rectangles(board)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6g}mm" height="{height:.6g}mm" '
        f'viewBox="0 0 {width:.6g} {height:.6g}" shape-rendering="crispEdges">\n'
        f'<rect width="100%" height="100%" fill="white"/>\n{rectangles}\n'
        f'<text x="{_margin_mm(board):.6g}" y="{height - 4:.6g}" font-family="sans-serif" '
        f'font-size="{_text_mm(board):.3g}" fill="#666">{_caption(board)}</text>\n</svg>\n'
    ).encode()


def _text_mm(board: Board) -> float:
    """Return a size of letters with which the caption fits under the board [mm]."""
    return min(_TEXT_MM, page_size_mm(board)[0] / (0.6 * len(_caption(board))))


def _pdf(board: Board) -> bytes:
    """Return a one-page PDF; its page is the drawing, so that '100 %' and 'actual size' are true."""
    width, height = (side / _POINT_MM for side in page_size_mm(board))
    # PDF counts upwards from the lower left
    drawing = [
        f"{x / _POINT_MM:.4f} {height - (y + h) / _POINT_MM:.4f} {w / _POINT_MM:.4f} {h / _POINT_MM:.4f} re"
        for x, y, w, h in black_rectangles(board)
    ]
    caption = _caption(board).replace("(", r"\(").replace(")", r"\)")
    left, size = _margin_mm(board) / _POINT_MM, _text_mm(board) / _POINT_MM
    text = f"0.4 g BT /F1 {size:.2f} Tf {left:.2f} {4 / _POINT_MM:.2f} Td ({caption}) Tj ET"
    stream = ("0 g\n" + "\n".join(drawing) + f"\nf\n{text}\n").encode("latin-1")
    page = f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        page.encode() + b"/Resources << /Font << /F1 5 0 R >> >> >>",
        b"<< /Length %d >>\nstream\n" % len(stream) + stream + b"endstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    return _pdf_file(objects)


def _pdf_file(objects: list[bytes]) -> bytes:
    file, places = b"%PDF-1.4\n", []
    for number, content in enumerate(objects, 1):
        places.append(len(file))
        file += b"%d 0 obj\n" % number + content + b"\nendobj\n"
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    count = len(objects) + 1
    end = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (count, len(file))
    return file + b"xref\n0 %d\n0000000000 65535 f \n" % count + table + end


def _png(board: Board, dpi: float) -> bytes:
    page = draw_board(board, dpi / 25.4)
    size = _text_mm(board) * dpi / 25.4
    place = (round(_margin_mm(board) * dpi / 25.4), round(page.shape[0] - 4 * dpi / 25.4))
    cv2.putText(
        page, _caption(board), place, cv2.FONT_HERSHEY_SIMPLEX, size / 32, 100, 1, cv2.LINE_AA
    )
    file = io.BytesIO()
    Image.fromarray(page).save(file, "PNG", dpi=(dpi, dpi))
    return file.getvalue()
