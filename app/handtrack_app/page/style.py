"""What is changed of viser's page: how it draws its widgets, and who hears keys while a dialog is open."""

from __future__ import annotations

import json

import viser

from handtrack_app import viser_internals as internals

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
/* the timeline below all else, as wide as the window: nothing stands before scene and panels */
:root { --handtrack-below: 142px; }
div:has(> .mantine-Paper-root[style*="position: absolute"] .handtrack-timeline) {
  height: calc(100% - var(--handtrack-below)) !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) {
  position: fixed !important; inset: auto 0 0 0 !important; width: 100vw !important; height: var(--handtrack-below) !important;
  z-index: 4 !important; border-radius: 0 !important; overflow: hidden !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) [role="tablist"] { display: none !important; }
div:has(> .handtrack-timeline) + div + div { margin-top: calc(-1 * var(--handtrack-lanes)); height: var(--handtrack-lanes);
  padding: 0 10px 0 0 !important; position: relative; pointer-events: none; }
div:has(> .handtrack-timeline) + div + div > .mantine-Flex-root { height: 100%; align-items: stretch !important; }
div:has(> .handtrack-timeline) + div + div > .mantine-Flex-root > div:first-child { visibility: hidden; width: 120px !important;
  padding: 0 !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Flex-root .mantine-Flex-root { height: 100%; align-items: flex-end; }
div:has(> .handtrack-timeline) + div + div :is(.mantine-InputWrapper-root, .mantine-Slider-root) { pointer-events: auto; }
div:has(> .handtrack-timeline) + div + div :is(.mantine-Slider-root, .mantine-Slider-trackContainer) { height: 100% !important;
  padding: 0 !important; cursor: crosshair; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-track { height: 100% !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-track::before, div:has(> .handtrack-timeline) + div + div
  :is(.mantine-Slider-bar, .mantine-Slider-markWrapper) { display: none !important; }
div:has(> .handtrack-timeline) + div + div .mantine-Slider-thumb { height: 100% !important; width: 2px !important; border: 0 !important;
  border-radius: 0 !important; background: currentColor !important; box-shadow: none !important; }
div:has(> .handtrack-queue) ~ div .mantine-Button-root { height: auto !important; padding: .25em .6em !important; font-size: .8em; }
div:has(> .handtrack-queue) ~ div .mantine-Button-inner { justify-content: flex-start; }
div:has(> .handtrack-queue) ~ div .mantine-Button-label { white-space: normal; text-align: left; height: auto; line-height: 1.3;
  font-weight: 500; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-timeline) div[style*="padding-top: var(--mantine-spacing-xs)"] {
  padding-top: 0 !important; }
.mantine-Paper-root[style*="position: absolute"]:has(.handtrack-picture) { width: calc(100vw - 684px) !important; }
/* notices above the hand, in a strip that a hand that is zoomed to leaves free */
.mantine-Notifications-root { top: .3em !important; width: min(46em, calc(100vw - 670px)) !important; }
.mantine-Notification-root { padding-block: .25em !important; margin-bottom: .3em !important; max-height: none !important; }
.mantine-Notification-title, .mantine-Notification-description { overflow: visible !important; white-space: normal !important;
  text-overflow: clip !important; margin-bottom: 0 !important; }
.mantine-Notification-description { font-size: .8em !important; line-height: 1.3; }
div:has(> .handtrack-note) + div .mantine-Button-root { height: auto !important; margin: 0 .3em .4em; width: auto !important; padding: .15em .6em !important; font-size: .8em; }
[data-mantine-color-scheme="light"] div[style*="background-color: rgb(255, 255, 255)"]:has(canvas) {
  background-color: #c3c9d2 !important; }
.handtrack-warning { color: #f0e442; }
.handtrack-text { padding: .3em .9em; font-size: 13px; line-height: 1.4; overflow-wrap: anywhere; }
.handtrack-faint { opacity: .85; }
.handtrack-row { display: flex; gap: .8em; justify-content: space-between; }
.handtrack-row > b { text-align: right; font-variant-numeric: tabular-nums; }
.handtrack-chip { display: inline-block; width: .7em; height: .7em; border-radius: 2px; margin-right: .4em; }
.handtrack-table { width: 100%; padding: .2em .9em; font-size: 13px; line-height: 1.4; }
[data-mantine-color-scheme="light"] .handtrack-warning { color: #a14a00; }
"""
_SCRIPT = """
if (document.getElementById("handtrack-style") === null) {
  const sheet = document.createElement("style");
  sheet.id = "handtrack-style";
  sheet.textContent = %s;
  document.head.append(sheet);
  // keys are heard by the document's root: a dialog's end before it, all but Escape, which closes it
  let awaited = false;  // the palette, which takes a moment to open
  document.body.addEventListener("keydown", (event) => {
    const open = document.querySelector('[role="dialog"]') !== null;
    if (event.key === "Escape") awaited = false;
    else if (open || awaited) event.stopPropagation();
    else awaited = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === (event.shiftKey ? "p" : "k");
    if (open) awaited = false;
  });
}
"""


def dress(server: viser.ViserServer) -> None:
    """Give all pages of a server the workbench's style, which no folded panel takes along, and its dialogs their keys."""
    source = _SCRIPT % json.dumps(_STYLE_SHEET)
    internals.run_javascript(server, source)
