"""HTML that several panels show; and what is changed of viser's page: how it draws its widgets, and who hears keys."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Iterable, Mapping

import cv2
import viser

from handtrack_app import viser_internals as internals
from handtrack_app.protocol import Image


def text(words: str, faint: bool = True, kind: str = "") -> str:
    """Return a paragraph; nothing for no words. words: HTML. kind: a class for the style sheet."""
    if not words:
        return ""
    return f"<div class='handtrack-text {'handtrack-faint' if faint else ''} {kind}'>{words}</div>"


def told(words: str) -> str:
    """Return words as the terminal has them, `code` and *name of a widget*, as HTML."""
    words = re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(words))
    return re.sub(r"(?<!\w)\*([^*\s][^*]*)\*(?!\w)", r"<b>\1</b>", words)


def escaped(words: str) -> str:
    """Return a paragraph of plain words."""
    return text(html.escape(words))


def row(name: str, value: str, more: str = "") -> str:
    """Return a name at the left and a value at the right, and what a tooltip says: plain words."""
    title = f" title='{html.escape(more)}'" if more else ""
    return f"<div class='handtrack-row'{title}><span>{html.escape(name)}</span><b>{html.escape(value)}</b></div>"


def line(words: str) -> str:
    """Return a faint line (HTML) that goes with what stands above it, within a paragraph."""
    return f"<div class='handtrack-line handtrack-faint'>{words}</div>"


def bordered(words: str, colour: str, kind: str = "") -> str:
    """Return a paragraph (HTML) with a border of a colour at its left. kind: a class for the style sheet."""
    return f"<div class='handtrack-bordered {kind}' style='border-color:{colour}'>{words}</div>"


def bar(share: float, colour: str = "#009e73") -> str:
    """Return a bar of which a share [0, 1] is done."""
    return f"<div class='handtrack-bar'><div style='width:{100 * share:.1f}%;background:{colour}'></div></div>"


def chip(colour: str) -> str:
    """Return a small square of a colour."""
    return f"<span class='handtrack-chip' style='background:{colour}'></span>"


def table(rows: str) -> str:
    """Return rows (HTML) as a table."""
    return f"<table class='handtrack-table'>{rows}</table>"


def picture(image: Image, name: str = "") -> str:
    """Return a picture RGB, which a browser shows together with the words that come with it; viser's own widget loads it first."""
    packed = cv2.imencode(".jpg", image[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 80))[1]
    data = base64.b64encode(packed.tobytes()).decode()
    return f"<img alt='{html.escape(name)}' decoding='sync' src='data:image/jpeg;base64,{data}'>"


def pictures(shown: Mapping[str, str], kind: str = "") -> str:
    """Return pictures (HTML) side by side, each with its name below. kind: a class for the style sheet."""
    figures = "".join(
        f"<figure>{one}<figcaption>{html.escape(name)}</figcaption></figure>"
        for name, one in shown.items()
    )
    return f"<div class='handtrack-pictures {kind}'>{figures}</div>"


def sheet(frame: int, images: Mapping[str, Image]) -> str:
    """Return the cameras' small pictures of a frame side by side."""
    return pictures({f"{name} {frame}": picture(one, name) for name, one in images.items()})


def card(name: str, lines: Iterable[str], picture: str = "", kind: str = "") -> str:
    """Return a card of plain words; the button after it lies over it. picture: HTML. kind: a class for the style sheet."""
    words = "".join(f"<div>{html.escape(line)}</div>" for line in lines)
    kinds = f"handtrack-card {kind}".strip()
    return f"<div class='{kinds}'><span>{picture}</span><div><b>{html.escape(name)}</b>{words}</div></div>"


def rgb(colour: Iterable[float]) -> str:
    """Return a colour as CSS has it."""
    return f"rgb{tuple(map(int, colour))}"


# ---- What is changed of viser's page: how it draws its widgets, and who hears keys while a dialog is open


_LEGENDS = {
    "outline": (("#ffc20a", "model's outline"),),
    "residual": (
        ("#e69f00", "silhouette without model; detected joint"),
        ("#0072b2", "model without silhouette; line to the model's joint"),
    ),
    "mask": (
        ("#009e73", "mask"),
        ("repeating-linear-gradient(135deg, #cc79a7 0 2px, transparent 2px 4px)", "unknown"),
        ("#56b4e9", "corrected (outline)"),
    ),
    "field": (
        (
            "linear-gradient(90deg, #440154, #21918c, #fde725)",
            "model's field: from its edge to the bones",
        ),
    ),
}
"""by overlay; as `handtrack.diagnostics.residuals` draws them, which the page's process does not import"""
_LOST = (
    "<b>No connection to handtrack.</b> The page shows its last state, and takes no edits. It connects again by itself if handtrack still runs. "
    "If handtrack has ended, start it again and use the page that it opens: what was saved is kept."
)
_STYLE_SHEET = """
p.mantine-Text-root[style*="letter-spacing"], .mantine-Input-input { letter-spacing: 0 !important; }
.mantine-Paper-root[data-with-border="true"]:has(> .mantine-Paper-root) {
  border-width: 1px 0 0 0 !important; border-color: rgba(128, 128, 128, .3) !important; border-radius: 0 !important;
  margin: .2em .6em 0 .6em !important; padding: 0 !important; }
.mantine-Paper-root[data-with-border="true"] > .mantine-Paper-root {
  position: static !important; transform: none !important; display: flex !important; width: 100%;
  justify-content: space-between; align-items: center; background: none !important; margin: 0 !important;
  padding: .45em .1em .35em .1em !important; font-weight: 600; }
.mantine-Paper-root[data-with-border="true"] > .mantine-Paper-root:hover { opacity: .8; }
.mantine-Paper-root[data-with-border="true"] > div > div { padding-top: 0 !important; }
.mantine-Paper-root[data-with-border="true"] > div > div > div > div { padding-inline: 0 !important; margin-inline: 0 !important; }
[role="tab"][data-dock-tab] { padding: 0 .55em !important; }
.multi-slider { margin-inline: 6px 12px; width: calc(100% - 18px) !important; }
.mantine-ScrollArea-viewport > .mantine-ScrollArea-content { padding-right: 6px; }
.mantine-Slider-mark, .mantine-Slider-markWrapper > .mantine-Slider-mark { opacity: .35; }
/* the timeline below all else, as wide as the window: nothing stands before scene and panel */
:root { --handtrack-below: 82px; --handtrack-lanes: 80px; }
div:has(> .mantine-Paper-root[style*="position: absolute"] .handtrack-timeline) {
  height: calc(100% - var(--handtrack-below)) !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) { position: fixed !important; inset: auto 0 0 0 !important; width: 100vw !important; height: var(--handtrack-below) !important;
  z-index: 4 !important; border-radius: 0 !important; overflow: hidden !important; border-top: 1px solid rgba(128, 128, 128, .35) !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline)::before { content: ""; position: absolute; inset: 0 0 auto 0; height: 5px; z-index: 7; cursor: ns-resize; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) [role="tablist"], .mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) div:has(> [role="button"]):has(.tabler-icon-minus), .mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) > div[style*="cursor"] { display: none !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) div[style*="padding-top: var(--mantine-spacing-xs)"] { padding-top: 0 !important; }
div:has(> .handtrack-timeline) + div + div { margin-top: calc(-1 * var(--handtrack-lanes)); height: var(--handtrack-lanes);
  padding: 0 !important; position: relative; pointer-events: none; }
div:has(> .handtrack-timeline) + div + div > .mantine-Flex-root { height: 100%; align-items: stretch !important; }
div:has(> .handtrack-timeline) + div + div > .mantine-Flex-root > div:first-child { visibility: hidden; width: 172px !important;
  padding: 0 !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Flex-root .mantine-Flex-root { height: 100%; align-items: flex-end;
  padding-right: 90px; }
div:has(> .handtrack-timeline) + div + div .mantine-InputWrapper-root { position: absolute; left: 4px; top: 56px; margin: 0 !important;
  width: 64px !important; }
div:has(> .handtrack-timeline) + div + div :is(.mantine-InputWrapper-root, .mantine-Slider-root) { pointer-events: auto; }
div:has(> .handtrack-timeline) + div + div :is(.mantine-Slider-root, .mantine-Slider-trackContainer) { height: 100% !important;
  padding: 0 !important; cursor: crosshair; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-track { height: 100% !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-track::before, div:has(> .handtrack-timeline) + div + div
  :is(.mantine-Slider-bar, .mantine-Slider-markWrapper) { display: none !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-thumb { height: 100% !important; width: 2px !important; border: 0 !important;
  border-radius: 0 !important; background: currentColor !important; box-shadow: none !important; }
/* transport, zoom and speed in the timeline's left column; a frame box below them */
div:has(> .handtrack-timeline) ~ div:nth-last-child(-n+3) { position: absolute; left: 4px; padding: 0 !important; width: 164px; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(3) { top: 3px; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(2) { top: 29px; width: 130px; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(1) { top: 56px; left: 76px; width: 90px; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(-n+3) > .mantine-Flex-root > div:first-child { position: absolute; width: 1px !important;
  height: 1px; overflow: hidden; clip-path: inset(50%); padding: 0 !important; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(-n+3) .mantine-Flex-root { gap: 3px !important; flex-wrap: nowrap !important; }
div:has(> .handtrack-timeline) ~ div:nth-last-child(-n+3) .mantine-Button-root { border: 0 !important; padding: 0 !important; height: 24px !important;
  min-width: 28px; background: rgba(128, 128, 128, .16) !important; color: inherit !important; }
.handtrack-lane { position: absolute; left: 4px; display: flex; align-items: center; gap: .6em; line-height: 1.1; font-size: 11px;
  white-space: nowrap; pointer-events: none; z-index: 1; text-shadow: 0 0 3px var(--mantine-color-body), 0 0 3px var(--mantine-color-body); }
.handtrack-lane > * { background: color-mix(in srgb, var(--mantine-color-body) 75%, transparent); border-radius: 2px; }
/* the next step: over an empty timeline in its middle, else above its right end, beside the panel: no frame is behind it */
div:has(> .handtrack-next), div:has(> .handtrack-next) + div { position: absolute; left: 172px; right: 90px; top: 3px; z-index: 6;
  padding: 0 !important; text-align: center; font-size: 13px; pointer-events: none; }
div:has(> .handtrack-next) + div { top: 24px; }
.handtrack-next:not(:empty) { display: inline-block; padding: 0 .6em; border-radius: 4px; background: var(--mantine-color-body); }
div:has(> .handtrack-next.handtrack-aside) + div { position: fixed; inset: auto 336px calc(var(--handtrack-below) + 10px) auto; }
div:has(> .handtrack-next) + div .mantine-Button-root { display: inline-block !important; width: auto !important; height: 27px !important; padding: 0 1.1em !important;
  pointer-events: auto; box-shadow: 0 0 6px var(--mantine-color-body); }
.handtrack-keys { columns: 21em auto; column-gap: 1.5em; padding: .3em .9em; font-size: 13px; line-height: 1.5; max-height: 60vh; overflow: auto; }
.handtrack-keys > div { display: flex; gap: .8em; break-inside: avoid; }
.handtrack-keys kbd { flex: 0 0 7.5em; }
[role="dialog"]:has(.handtrack-keys) { min-width: min(70em, 92vw); }
.handtrack-bar { height: 5px; border-radius: 3px; background: rgba(128, 128, 128, .3); margin: .35em 0; }
.handtrack-bar > div { height: 100%; border-radius: 3px; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-picture) { width: calc(100vw - 320px) !important; }
/* the rail: an icon over its name, five side by side */
div:has(> .handtrack-rail) + div [role="tablist"] { flex-wrap: nowrap !important; background-image: none !important;
  border-bottom: 1px solid rgba(128, 128, 128, .3); }
div:has(> .handtrack-rail) + div [role="tab"] { flex: 1 1 0; flex-direction: column; justify-content: center; height: 3.6em !important;
  padding: 0 .2em !important; gap: .15em; font-size: 13px; }
div:has(> .handtrack-rail) + div [role="tab"] > * { margin: 0 !important; overflow: visible !important; }
div:has(> .handtrack-rail) + div [role="tablist"] ~ * [role="tablist"] { flex-wrap: wrap !important; }
div:has(> .handtrack-rail) + div [role="tablist"] ~ * [role="tab"] { flex: 0 0 auto; height: 2.2em !important; padding: 0 .2em !important;
  font-size: 12.5px; letter-spacing: -.01em; }
/* notices above the hand, in a strip that a hand that is zoomed to leaves free */
.mantine-Notifications-root { top: .3em !important; width: min(46em, calc(100vw - 320px)) !important; }
.mantine-Notification-root { padding-block: .25em !important; margin-bottom: .3em !important; max-height: none !important; }
.mantine-Notification-title, .mantine-Notification-description { overflow: visible !important; white-space: normal !important;
  text-overflow: clip !important; margin-bottom: 0 !important; }
.mantine-Notification-title, .mantine-Paper-root[style*="cursor: pointer"] { font-size: 13px !important; }
.mantine-Notification-description { font-size: 13px !important; line-height: 1.3; color: inherit !important; opacity: .9; }
/* rows of three buttons fit beside their label */
div[style*="width: 7.25em"] { width: 5.9em !important; }
.mantine-Flex-root[style*="wrap"] > .mantine-Button-root { padding-inline: .2em !important; }
.mantine-Flex-root[style*="wrap"] { gap: .3em !important; }
/* legible: 13 px and 4.5 : 1 */
p.mantine-Text-root[style*="letter-spacing"] { font-size: 13px !important; color: var(--mantine-color-text) !important; opacity: .9; }
.multi-slider-mark-label, .mantine-Slider-markLabel { font-size: 11px !important; color: var(--mantine-color-text) !important; opacity: .85; }
.mantine-NumberInput-root[style*="width: 3rem"] { width: 3.5rem !important; }
.mantine-NumberInput-root[style*="width: 3rem"] .mantine-Input-input { padding-inline: 2px !important; text-align: center; }
.multi-slider-mark:only-child { width: 3px; height: 12px; border-radius: 1px; transform: none; background-color: #e69f00 !important; }
.mantine-Input-input, .mantine-Button-label, .mantine-Checkbox-label { font-size: 13px !important; }
.mantine-Button-root[style*="--button-color: var(--mantine-color-black)"]:not([style*="--button-bg"]) { --button-color: #fff !important; }
[data-mantine-color-scheme="light"] .mantine-Button-root[style*="--button-color: var(--mantine-color-black)"]:not([style*="--button-bg"]) {
  --button-bg: #0072b2 !important; --button-hover: #005f96 !important; }
[data-mantine-color-scheme="light"] .mantine-Button-root[style*="gray-filled"] { --button-bg: #5c6670 !important; }
[data-mantine-color-scheme="light"] .mantine-Button-root[data-variant="outline"] { --button-color: #005f96 !important; border-color: #005f96 !important; }
[role="tab"] { opacity: 1 !important; color: var(--mantine-color-text) !important; }
[role="tab"][aria-selected="true"] { font-weight: 600; }
div:has(> .handtrack-queue) ~ div .mantine-Button-root { height: auto !important; padding: .25em .6em !important; font-size:.9em; }
div:has(> .handtrack-queue) ~ div .mantine-Button-inner { justify-content: flex-start; }
div:has(> .handtrack-queue) ~ div .mantine-Button-label { white-space: normal; text-align: left; height: auto; line-height: 1.3;
  font-weight: 500; }
/* an answer stays in sight while the panel is scrolled, with its button in its corner; what hides more than it holds would hold it back */
div:has(> .handtrack-answer) { position: sticky; top: -8px; z-index: 5; padding-block: 8px 4px; background: var(--mantine-color-body); }
div:has(> div > div > div > .handtrack-answer) { overflow: visible !important; }
.handtrack-answer { max-height: 40vh; overflow: auto; }
.handtrack-note > b { display: block; padding-right: 6em; }
div:has(+ div > .handtrack-note) { position: relative; z-index: 6; height: 0; padding-block: 0 !important; }
div:has(+ div > .handtrack-answer) { position: sticky; top: 0; }
div:has(+ div > .handtrack-note) .mantine-Button-root { display: block; margin-left: auto; height: auto !important; width: auto !important; padding: .15em .6em !important; font-size: .9em; }
[data-mantine-color-scheme="light"] div[style*="background-color: rgb(255, 255, 255)"]:has(canvas) {
  background-color: #c3c9d2 !important; }
a[data-frame] { color: inherit; }
.handtrack-error { color: #ff8a5c; }
[data-mantine-color-scheme="light"] .handtrack-error { color: #b03a00; }
/* what the colours of an overlay mean: at the picture's lower left while a camera is looked through */
#handtrack-legend { display: none; position: fixed; left: 12px; bottom: calc(var(--handtrack-below) + 10px); z-index: 3; padding: .3em .8em;
  font: 13px var(--mantine-font-family); color: #fff; background: rgba(20, 20, 20, .8); border-radius: 4px; pointer-events: none; }
#handtrack-legend > div { display: none; }
#handtrack-legend > .field > .handtrack-chip { width: 5em; }
/* viser only dims and freezes its widgets while no server answers, and goes on showing what was true before */
#handtrack-lost { display: none; position: fixed; top: .6em; left: 50%; transform: translateX(-50%); z-index: 400; width: min(38em, 90vw); padding: .6em 1em;
  font: 14px/1.4 var(--mantine-font-family); color: #000; background: #f2b56b; border-radius: 4px; box-shadow: 0 0 8px rgba(0, 0, 0, .6); }
body:has(div[style*="pointer-events: none"][style*="opacity 150ms"]) #handtrack-lost { display: block; animation: handtrack-lost 1s 2s steps(1) backwards; }
@keyframes handtrack-lost { from { visibility: hidden; } }
#handtrack-heading { position: absolute; width: 1px; height: 1px; margin: 0; overflow: hidden; clip-path: inset(50%); }
#handtrack-brush { display: none; position: fixed; z-index: 3; border: 1px solid #fff; outline: 1px solid #000; border-radius: 50%; pointer-events: none; }
#handtrack-held { position: fixed; z-index: 3; padding: .1em .5em; font: 13px var(--mantine-font-family); color: #fff; background: rgba(20, 20, 20, .8);
  border-radius: 4px; pointer-events: none; }
#handtrack-held:empty { display: none; }
.handtrack-warning { color: #f0e442; }
.handtrack-text { padding: .3em .9em; font-size: 13px; line-height: 1.4; overflow-wrap: anywhere; }
.handtrack-faint { opacity: .85; }
.handtrack-line { margin-top: .2em; line-height: 1.3; }
.handtrack-bordered { margin: .3em .9em .4em; padding: .15em .6em; border-left: 3px solid; font-size: 13px; line-height: 1.4; overflow-wrap: anywhere; }
.handtrack-number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
.handtrack-row { display: flex; gap: .8em; justify-content: space-between; }
.handtrack-row > :first-child { overflow-wrap: normal; }
.handtrack-row > b { text-align: right; font-variant-numeric: tabular-nums; }
.handtrack-chip { display: inline-block; width: .7em; height: .7em; border-radius: 2px; margin-right: .4em; }
/* on a phone the panel is a sheet below the scene, as wide as the window */
@media (max-width: 575px) {
  .mantine-Paper-root[style*="position: fixed"]:has(.handtrack-head) { width: 100vw !important; max-height: 45vh !important; }
  .mantine-Paper-root[style*="position: fixed"]:has(.handtrack-head) div[style*="width: 20em"] { width: 100% !important; }
  .mantine-ScrollArea-viewport > .mantine-ScrollArea-content { padding-right: 0; }
  .mantine-Notifications-root { width: calc(100vw - 20px) !important; }
  div:has(> div > .handtrack-timeline) { position: relative; }
  .handtrack-next:not(:empty) { display: none; }
  div:has(> .handtrack-next.handtrack-aside) + div { position: absolute; inset: 24px 90px auto 172px; }
}
/* in a low window, as of 150 %, the tabs need the room: the session's counts and a reason's numbers go, and the others share a line */
@media (max-height: 640px), (max-width: 575px) {
  .handtrack-counts, .handtrack-detail { display: none; }
  .handtrack-score > .handtrack-row { display: inline-flex; gap: .35em; margin-right: .8em; }
}
.handtrack-table { width: 100%; border-spacing: 0 1px; border-collapse: separate; padding: .2em .9em; font-size: 13px; line-height: 1.4; }
[data-mantine-color-scheme="light"] .handtrack-warning { color: #a14a00; }
/* a card, as of the start page and of Review: its button lies over it */
.handtrack-card { display: flex; gap: .9em; align-items: center; height: 76px; margin: .25em .9em; font-size: 13px; line-height: 1.4; }
.handtrack-card > span { flex: 0 0 100px; height: 68px; background: rgba(128, 128, 128, .25); border-radius: 4px; overflow: hidden; }
.handtrack-card img { width: 100%; height: 100%; object-fit: cover; }
.handtrack-card > div { overflow-wrap: anywhere; padding-right: 6em; }
.handtrack-card.handtrack-interval > div { padding-right: .4em; line-height: 1.3; }
.handtrack-card.handtrack-here { outline: 2px solid #3594d6; border-radius: 4px; }
div:has(> .handtrack-card) + div { margin-top: -80px; position: relative; }
div:has(> .handtrack-card) + div .mantine-Button-root { height: 76px !important; background: rgba(128, 128, 128, .08) !important; color: transparent !important;
  border: 1px solid rgba(128, 128, 128, .35) !important; }
div:has(> .handtrack-card) + div .mantine-Button-root:hover { background: rgba(128, 160, 255, .18) !important; }
.handtrack-pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(7em, 1fr)); gap: .5em; padding: 0 var(--mantine-spacing-xs) .5em; }
.handtrack-pictures.handtrack-picture { grid-template-columns: repeat(auto-fit, minmax(15em, 1fr)); padding-top: .5em; text-align: center; }
.handtrack-pictures figure { margin: 0; font-size: 13px; }
.handtrack-pictures img { width: 100%; max-height: 70vh; object-fit: contain; border-radius: 4px; display: block; }
"""
_SCRIPT = """
if (document.getElementById("handtrack-style") === null) {
  const sheet = document.createElement("style");
  sheet.id = "handtrack-style";
  sheet.textContent = %s;
  document.head.append(sheet);
  const legend = document.createElement("div");
  legend.id = "handtrack-legend";
  legend.innerHTML = %l;
  // a screen reader finds the page's one part and its heading
  const main = document.getElementById("root"), heading = document.createElement("h1");
  main.setAttribute("role", "main");
  heading.id = "handtrack-heading";
  heading.textContent = "handtrack";
  main.append(heading, legend);
  const lost = document.createElement("div");
  lost.id = "handtrack-lost";
  lost.setAttribute("role", "alert");
  lost.innerHTML = %d;
  main.append(lost);
  // a brush is a circle about the pointer, in its size over the image
  const brush = document.createElement("div");
  brush.id = "handtrack-brush";
  main.append(brush);
  document.addEventListener("pointermove", (event) => {
    const view = window.__viserMutable, tangent = Number(document.body.dataset.brush);
    const shown = tangent > 0 && event.target instanceof Element && event.target.closest(".mantine-Paper-root") === null;
    brush.style.display = shown ? "block" : "none";
    const size = shown ? tangent * view.canvas.clientHeight / Math.tan(view.camera.fov * Math.PI / 360) : 0;
    Object.assign(brush.style, {left: `${event.clientX - size / 2}px`, top: `${event.clientY - size / 2}px`, width: `${size}px`, height: `${size}px`});
  }, true);
  const held = document.createElement("div");
  held.id = "handtrack-held";
  main.append(held);
  // viser tells no server of a pointer that only moves: the script looks itself, by the grips as they are drawn and by the rules of
  // `hold_at`. The name of what the pointer meets first: a joint where it is near one, else the segment; empty beside the hand
  const heldAt = (x, y) => {
    const view = window.__viserMutable, known = window.handtrackHolds, camera = view?.camera;
    let mesh = null;
    view?.nodeRefFromName?.[known?.node]?.traverse((one) => { if (one.getMatrixAt) mesh ??= one; });
    if (mesh === null) return "";
    const Vector = camera.position.constructor, Matrix = camera.matrixWorld.constructor;
    const frame = view.canvas.getBoundingClientRect(), count = known.segments.length;
    const placed = (i) => mesh.getMatrixAt(i, new Matrix()).premultiply(mesh.matrixWorld);
    const eye = new Vector().setFromMatrixPosition(camera.matrixWorld);
    const ahead = new Vector(2 * (x - frame.left) / frame.width - 1, 1 - 2 * (y - frame.top) / frame.height, 0.5).unproject(camera).sub(eye);
    let nearest = Infinity, segment = -1;
    for (let i = 0; i < count; i++) {  // in the ellipsoid's own frame it is a ball
      const inverse = placed(i).invert(), from = eye.clone().applyMatrix4(inverse);
      const way = eye.clone().add(ahead).applyMatrix4(inverse).sub(from);
      const a = way.dot(way), b = way.dot(from), root = b * b - a * (from.dot(from) - known.radius ** 2);
      const meets = (-b - Math.sqrt(root)) / a;
      if (root >= 0 && meets > 0 && meets < nearest) { nearest = meets; segment = i; }
    }
    if (segment < 0) return "";
    const at = eye.clone().addScaledVector(ahead, nearest);
    const depth = -at.clone().applyMatrix4(camera.matrixWorldInverse).z;
    let best = known.near * frame.height / 2 / Math.tan(camera.fov * Math.PI / 360) / Math.max(depth, known.least), name = known.segments[segment];
    known.joints.forEach((words, k) => {
      const place = new Vector().setFromMatrixPosition(placed(count + k));
      if (place.distanceTo(at) > known.behind) return;
      const seen = place.project(camera);
      const off = Math.hypot(frame.left + (seen.x + 1) / 2 * frame.width - x, frame.top + (1 - seen.y) / 2 * frame.height - y);
      if (off < best) { best = off; name = words; }
    });
    return name;
  };
  let asked = 0, last = null;
  const look = () => {
    asked = 0;
    if (last.buttons) return;  // while it is dragged the name stays
    held.textContent = last.target === window.__viserMutable?.canvas ? heldAt(last.clientX, last.clientY) : "";
  };
  const follow = (event) => {
    last = event;
    Object.assign(held.style, {left: `${event.clientX + 14}px`, top: `${event.clientY + 14}px`});
    asked ||= requestAnimationFrame(look);
  };
  document.addEventListener("pointermove", follow, true);
  document.addEventListener("pointerup", follow, true);
  setInterval(() => { if (held.textContent) look(); }, 300);  // the view may turn, or the hand move, under a pointer that rests
  // keys are heard by the document's root. They act where neither a dialog is open nor a control has the focus
  const controls = 'input, textarea, select, button, [role="slider"], [role="tab"], [role="combobox"], [role="checkbox"]';
  let awaited = false;  // the palette, which takes a moment to open
  document.body.addEventListener("keydown", (event) => {
    const open = document.querySelector('[role="dialog"]') !== null, held = event.ctrlKey || event.metaKey || event.altKey;
    const busy = event.target instanceof Element && event.target.closest(controls) !== null && !held;
    // a frame's number is typed: keys act again
    if (busy && event.key === "Enter" && event.target.matches('.mantine-Paper-root:has(.handtrack-timeline) .mantine-NumberInput-root input')) event.target.blur();
    if (event.key === "Escape") {
      awaited = false;
      if (busy) event.target.blur();
      if (busy && open) {  // keys from a text field are not heard: the dialog closes all the same
        event.stopPropagation();
        document.body.dispatchEvent(new KeyboardEvent("keydown", {key: "Escape", code: "Escape", bubbles: true}));
      }
    }
    else if (open || awaited || busy || (event.key === "Tab" && event.shiftKey)) event.stopPropagation();
    else awaited = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === (event.shiftKey ? "p" : "k");
    if (open) awaited = false;
  });
  // the arrows step: viser's camera, which hears later, is not to turn by them
  document.documentElement.addEventListener("keydown", (event) => {
    if (event.key.startsWith("Arrow")) event.stopPropagation();
  });
  // a link to a frame types it into the timeline's box
  document.addEventListener("click", (event) => {
    const link = event.target instanceof Element ? event.target.closest("a[data-frame]") : null;
    const box = link && document.querySelector('.mantine-Paper-root:has(.handtrack-timeline) .mantine-NumberInput-root input');
    if (!link) return;
    event.preventDefault();
    if (box === null) return;
    box.focus({preventScroll: true});
    // what was typed there before is replaced: the box looks at a key where its caret is, and reads what comes by that
    box.select();
    box.dispatchEvent(new KeyboardEvent("keydown", {bubbles: true}));
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(box, link.dataset.frame);
    box.dispatchEvent(new Event("input", {bubbles: true}));
    box.blur();
  });
  // the timeline's upper edge is dragged up for more lanes, down for few; what was asked for comes later from the program
  let edge = null;
  document.addEventListener("pointerdown", (event) => {
    const panel = event.target instanceof Element && event.target.matches('.mantine-Paper-root:has(.handtrack-timeline)') ? event.target : null;
    const held = panel && event.clientY - panel.getBoundingClientRect().top < 6;
    edge = held ? {y: event.clientY, every: panel.querySelector(".handtrack-every") !== null} : null;
  });
  document.addEventListener("pointermove", (event) => {
    const by = edge === null || !event.buttons ? 0 : edge.y - event.clientY;
    if (Math.abs(by) <= 12) return;
    const buttons = document.querySelectorAll('.mantine-Paper-root:has(.handtrack-timeline) button');
    if ((by > 0) !== edge.every) [...buttons].find((one) => one.textContent === "☰")?.click();
    edge = {y: event.clientY, every: by > 0};
  });
  // what was pressed with the pointer does not keep the keys
  document.addEventListener("click", (event) => {
    const button = event.target instanceof Element ? event.target.closest('button, [role="tab"], input[type="checkbox"]') : null;
    if (button && event.detail > 0) button.blur();
    const option = event.target instanceof Element && event.target.closest('[role="option"]') !== null;
    if (option && event.detail > 0) setTimeout(() => document.activeElement?.blur());  // else keys are typed into the choice
  });
  // names for screen readers: viser's sliders, boxes and transport signs have none
  const signs = {"⇤": "First frame", "←": "Previous frame", "▶": "Play or pause", "→": "Next frame", "⇥": "Last frame",
    "+": "Fewer frames", "−": "More frames", "↔": "All frames", "☰": "More lanes"};
  const icons = {"list-search": "All commands", "adjustments": "Settings of the view"};
  const name = () => {
    for (const one of document.querySelectorAll("button:not([aria-label])")) {
      if (one.textContent.trim()) continue;
      const icon = Object.keys(icons).find((key) => one.querySelector(`[class*="tabler-icon-${key}"]`));
      if (icon || one.matches(".mantine-CloseButton-root")) one.setAttribute("aria-label", icon ? icons[icon] : "Close");
    }
    for (const one of document.querySelectorAll('[role="progressbar"]:not([aria-label])')) one.setAttribute("aria-label", "Progress");
    for (const one of document.querySelectorAll("img:not([alt])")) one.alt = "Pictures of the cameras";
    for (const one of document.querySelectorAll('[role="slider"], input, button')) {
      if (one.getAttribute("aria-label") || one.labels?.length) continue;
      const sign = signs[one.textContent.trim()];
      const row = one.closest('[style*="padding-inline"]')?.querySelector("label, p");
      const words = sign ?? (one.textContent.trim() ? null : row?.textContent.trim() ?? one.getAttribute("placeholder"));
      if (words) { one.setAttribute("aria-label", words); if (sign) one.title = sign; }
    }
  };
  const entitle = () => {
    const parts = [".handtrack-title", ".handtrack-frame"].map((one) => document.querySelector(one)?.textContent).filter(Boolean);
    const title = [...parts, "handtrack"].join(" · ");
    if (document.title !== title) document.title = title;
  };
  let due = 0;
  // at most every 300 ms, while it plays too; a slider that is drawn anew loses its name
  new MutationObserver(() => { due ||= setTimeout(() => { due = 0; name(); entitle(); }, 300); }).observe(
    document.body, {childList: true, subtree: true, attributeFilter: ["aria-label"]});
  name();
}
"""


def dress(server: viser.ViserServer) -> None:
    """Give all pages of a server the workbench's style, which no folded panel takes along, and its dialogs their keys."""
    legend = "".join(
        f"<div class='{overlay}'>{' &nbsp; '.join(f'{chip(colour)}{words}' for colour, words in entries)}</div>"
        for overlay, entries in _LEGENDS.items()
    )
    shown = "".join(
        f'body[data-overlay="{overlay}"] :is(#handtrack-legend, #handtrack-legend > .{overlay}) {{ display: block; }}\n'
        for overlay in _LEGENDS
    )
    source = _SCRIPT.replace("%s", json.dumps(_STYLE_SHEET + shown)).replace(
        "%l", json.dumps(legend)
    )
    source = source.replace("%d", json.dumps(_LOST))
    internals.run_javascript(server, source)
