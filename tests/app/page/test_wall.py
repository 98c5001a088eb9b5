"""All cameras side by side: as large as the window allows, inside it; a click leads into a camera, on the wire."""

import numpy as np
import pytest

from handtrack_app.engine.pictures.camera_pictures import CLOSE_SIZE, close_up
from handtrack_app.page.scene.looking import CLOSE, cells
from tests.app.waiting import eventually


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 9])
@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.4, 2.2])
def test_pictures_fill_the_window_and_none_covers_another(count, aspect):
    places, width = cells(count, aspect)
    height = width * 3 / 4
    assert len(places) == count
    for i, (x, y) in enumerate(places):
        assert abs(x) + width / 2 <= aspect / 2 + 1e-9
        assert abs(y) + height / 2 <= 0.5 + 1e-9
        for other_x, other_y in places[:i]:
            assert abs(x - other_x) >= width - 1e-9 or abs(y - other_y) >= height - 1e-9
    # no other arrangement in rows has larger ones
    best = max(min(aspect / c, 4 / 3 / -(-count // c)) for c in range(1, count + 1))
    assert width == pytest.approx(best)


def test_a_page_sees_all_cameras_and_a_click_leads_into_one(bench, wire, page):
    page.press("See the hand in all cameras")
    walls = bench.stage.looking.walls
    eventually(lambda: page.number in walls._walls, "the wall stands")
    wall = walls._walls[page.number]
    eventually(lambda: all(bool(image.visible) for image in wall.images.values()), "painted")
    assert {one for one in bench.stage.wanted()["want_pictures"][2] if one[1] == CLOSE} == {
        ("front", CLOSE), ("side", CLOSE),
    }  # fmt: skip
    assert np.asarray(wall.images["front"].image).shape == (*CLOSE_SIZE[::-1], 3)
    wire.send({
        "type": "SceneNodeClickMessage", "name": "/wall/side", "owner": str(page.number), "instance_index": None,
        "ray_origin": [0.0, 0.0, 0.0], "ray_direction": [0.0, 0.0, 1.0], "screen_pos": [0.5, 0.5], "modifier": None,
    })  # fmt: skip
    eventually(lambda: page.view is not None, "it looks through a camera")
    assert page.view is not None and page.view.card.name == "side"
    assert not wall.images["side"].visible
    eventually(lambda: CLOSE not in str(bench.stage.wanted()["want_pictures"]), "painted no more")


def test_a_close_picture_shows_the_hand_whole_and_large_with_its_outline(bench):
    document = bench.worker.document
    model = document.model
    flesh = model.flesh["fine"].posed(model.bones(model.transform.solver_params(document.start)))
    camera = document.run.session.rig["front"]
    picture = close_up(np.full((72, 96, 3), 90, np.uint8), camera, flesh)
    yellow = (picture[..., 0] > 200) & (picture[..., 2] < 90)
    rows, columns = np.nonzero(yellow)
    assert rows.min() > 20 and rows.max() < CLOSE_SIZE[1] - 20
    assert columns.min() > 20 and columns.max() < CLOSE_SIZE[0] - 20
    assert max(np.ptp(rows) / CLOSE_SIZE[1], np.ptp(columns) / CLOSE_SIZE[0]) > 0.5
