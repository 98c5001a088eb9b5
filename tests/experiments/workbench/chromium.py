"""A real browser before the workbench: headless Chromium with software rendering, told by Playwright."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
_FLAGS = [
    "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-precise-memory-info",
]  # fmt: skip
_NOISE = ("Unable to preventDefault inside passive event listener",)
"""what viser's own page tells of its canvas' wheel, whatever it shows"""
DRAWN = """(names) => {
  const m = window.__viserMutable, t = window.__viserTestpoints;
  return !!(m && m.scene && m.camera && t && t.rendererInfo.render.frame > 2
            && names.every((n) => m.nodeRefFromName[n]));
}"""
"""whether nodes of the scene are drawn"""
PROJECT = """([name, p]) => {
  const m = window.__viserMutable, node = m.nodeRefFromName[name];
  node.updateWorldMatrix(true, false);
  m.camera.updateMatrixWorld();
  const v = new node.position.constructor(p[0], p[1], p[2]);
  node.localToWorld(v).project(m.camera);
  const r = m.canvas.getBoundingClientRect();
  return [r.left + (v.x + 1) / 2 * r.width, r.top + (1 - v.y) / 2 * r.height];
}"""
"""where on the page a point of a node's frame is seen [px]"""


def there_is_one() -> bool:
    """Return whether the browser is installed where it is looked for (environment variable CHROMIUM)."""
    return Path(CHROMIUM).exists()


@contextlib.contextmanager
def chromium(size: tuple[int, int], *flags: str) -> Iterator[tuple[Any, list[str]]]:
    """Yield a blank page of a new browser, and the errors that its pages and console told. size: of the window [px].

    Nothing but this machine is asked for anything.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, headless=True, args=[*_FLAGS, *flags], timeout=600_000
        )
        try:
            page = browser.new_context(
                viewport={"width": size[0], "height": size[1]}, accept_downloads=True
            ).new_page()
            page.set_default_timeout(600_000)  # [ms]; other tests may have the processor meanwhile
            errors: list[str] = []
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.on("console", lambda said: _hear(said, errors))
            page.route("**/*", _on_this_machine)
            yield page, errors
        finally:
            browser.close()


def _hear(said: Any, errors: list[str]) -> None:
    given_up = said.location.get("url", "").startswith(
        "blob:"
    )  # a picture that a newer one replaced
    if said.type == "error" and not given_up and not said.text.startswith(_NOISE):
        errors.append(said.text)


def _on_this_machine(route: Any) -> None:
    url = route.request.url
    own = "127.0.0.1" in url or url.startswith(("blob:", "data:", "file:"))
    route.continue_() if own else route.abort()
