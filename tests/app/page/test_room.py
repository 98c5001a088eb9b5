"""A page's own room: folded panels, colours and text are its own, and its browser remembers them."""

import json

import pytest

from handtrack_app.page.panels.view import LARGE, LIGHT, Taste
from tests.app.waiting import eventually
from tests.app.wire import Browser, WireClient


def said(wire, kind):
    return [message for _, message in list(wire.messages) if message["type"] == kind]


def answer(wire, kept):
    """Answer what the browser remembers."""
    eventually(lambda: bool(said(wire, "LocalStorageGetItemRequestMessage")), "asked")
    wire.answer(said(wire, "LocalStorageGetItemRequestMessage")[-1], kept)


def folds(bench, wire):
    uuid = bench.page.gui.main_panel._placement_uuid
    told = said(wire, "GuiSetPanelCollapsedMessage")  # the first one is viser's own
    return [m["collapsed"] for m in told if m["uuid"] == uuid and m["counter"] > 1]


def test_a_page_gets_what_its_browser_remembers(bench, wire):
    answer(wire, json.dumps({"folded": True, "colours": LIGHT, "text": LARGE}))
    eventually(lambda: folds(bench, wire) == [True], "folded")
    eventually(lambda: said(wire, "ThemeConfigurationMessage")[-1]["dark_mode"] is False, "light")
    eventually(lambda: "--mantine-scale" in str(said(wire, "RunJavascriptMessage")[1:]), "large")


def test_keys_fold_and_the_browser_is_told_and_other_pages_keep_theirs(bench):
    with WireClient(bench.url) as one, WireClient(bench.url) as other:
        answer(one, None)
        answer(other, None)
        eventually(lambda: len(bench.server.get_clients()) == 2, "both are there")
        page = Browser(bench, one)
        page.press("Hide or show the panel")
        eventually(lambda: folds(bench, one) == [True], "folded")
        page.press("Light or dark")
        eventually(lambda: len(said(one, "LocalStorageSetItemMessage")) == 2, "remembered")
        kept = Taste.read(said(one, "LocalStorageSetItemMessage")[-1]["value"])
        assert kept == Taste(True, LIGHT)
        page.press("Hide or show the panel")
        eventually(lambda: folds(bench, one) == [True, False], "open again")
        assert folds(bench, other) == []
        assert all(m["dark_mode"] for m in said(other, "ThemeConfigurationMessage"))


@pytest.mark.parametrize("kept", [None, "", "{", "[]", "7", '{"folded": 3}', '{"folded": true}'])
def test_what_is_none_of_ours_is_forgotten(kept):
    assert Taste.read(kept) is None
