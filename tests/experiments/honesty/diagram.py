"""A reliability diagram: how often what is stated with a probability is so."""

from __future__ import annotations

from collections.abc import Mapping

_SIDE, _EDGE = 320, 40


def diagram(figures: Mapping[str, float]) -> str:
    """Return an SVG of the figures of `bench honesty`: a disc for each range of P, as large as frames are many, on the diagonal
    where it is honest.
    """
    discs = []
    for name, bad in figures.items():
        if not name.startswith("P ") or not name.endswith(": bad"):
            continue
        low, high = map(float, name[2 : -len(": bad")].split("-"))
        count = figures[f"{name[: -len('bad')]}frames"]
        x, y = _EDGE + _SIDE * 0.5 * (low + high), _EDGE + _SIDE * (1.0 - bad)
        discs.append(
            f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{2 + 0.5 * count**0.5:.1f}" fill="#1f77b4"/>'
            f'<text x="{x + 10:.0f}" y="{y - 8:.0f}">{count:.0f}</text>'
        )
    far, middle = _EDGE + _SIDE, _EDGE + _SIDE // 2
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{far + _EDGE}" height="{far + _EDGE}" '
            'font-family="sans-serif" font-size="12">',
            '<rect width="100%" height="100%" fill="white"/>',
            f'<path d="M{_EDGE} {far}L{far} {_EDGE}" stroke="#999" stroke-dasharray="4"/>',
            f'<path d="M{_EDGE} {_EDGE}V{far}H{far}" stroke="black" fill="none"/>',
            *discs,
            f'<text x="{middle}" y="{far + 30}" text-anchor="middle">stated P(a joint is 25 mm off)</text>',
            f'<text x="14" y="{middle}" text-anchor="middle" transform="rotate(-90 14 {middle})">share that is</text>',
            "</svg>",
            "",
        ]
    )
