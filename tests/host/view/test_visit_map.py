"""The lump's outline over the tactile image, and the map of a visit, in a real browser."""

from __future__ import annotations

import json
import struct

import pytest
from playwright.sync_api import expect

from palpate import models
from palpate.link import emulator_model as emulator
from palpate.sim.probe.over_lump import strokes_over
from palpate.stroke.read import load_strokes
from palpate.view.live import LiveSource
from palpate.view.replay import ReplaySource
from tests.host.conftest import emulated
from tests.host.probes import LUMP as CYLINDER
from tests.host.view import balls
from tests.host.view.pages import new_visit, once, opened, pick
from tests.host.view.synthetic import Bump, SyntheticSource
from tests.host.view.waiting import eventually, held, noticed, recording_begun, recording_ended, settled

__all__ = ["emulated"]

pytestmark = pytest.mark.browser

ON_THE_RIGHT = Bump(d_mm=12.0, across_mm=8.0, columns=(15, 22))
ON_THE_LEFT = Bump(d_mm=9.0, across_mm=-9.0, columns=(3, 10), hardness="soft", E_inv23=0.5)
ALL_ACROSS = Bump(columns=(0, 26))
NONE = Bump(kind="none")


def outline(page):
    """The outline on the tactile image, in mm on the face; None where there is none."""
    settled(page)
    found = page.locator("#image").get_attribute("data-outline")
    return None if found is None else json.loads(found)


def mapped(page, *numbers):
    """The lumps on the map, by stroke, once the strips of these strokes have come."""
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", " ".join(map(str, numbers)))
    settled(page)
    found = json.loads(page.locator("#visit-map").get_attribute("data-shapes"))
    return {shape["number"]: shape for shape in found}


def click_on_strip(page, number):
    """In the middle of where it was drawn."""
    settled(page)
    drawn = json.loads(page.locator("#visit-map").get_attribute("data-drawn"))
    (strip,) = (strip for strip in drawn if strip["number"] == number)
    middle = {"x": (strip["left"] + strip["right"]) / 2, "y": (strip["top"] + strip["bottom"]) / 2}
    page.locator("#visit-map").click(position=middle)


def by_lanes(running, page, next_mm=0, step_mm=20):
    """Open the map and say where strokes go, from the keyboard; a stroke that begins now goes there."""
    page.keyboard.press("l")
    page.locator("#lanes-told").focus()
    page.keyboard.press("Space")
    page.keyboard.press("l")  # a tick is no text: the page's keys go on
    expect(page.locator("#visit-map")).to_be_hidden()
    page.keyboard.press("l")
    for field, value in (("#lane-next", next_mm), ("#lane-step", step_mm)):
        page.locator(field).fill(str(value))
        page.keyboard.press("Enter")
        expect(page.locator(field)).to_have_attribute("data-shown", str(value))
    lanes = running.session.visits.lanes
    eventually(lambda: (lanes.told, lanes.next_mm, lanes.step_mm) == (True, next_mm, step_mm))


def run(page, module, code):
    """Run a line of JavaScript with a module of the page as `m`."""
    return page.evaluate(f"async () => {{ const m = await import('/static/{module}'); {code} }}")


# ---- the outline


def test_a_picked_stroke_shows_its_lump_on_the_side_where_it_was_felt(viewer, open_page):
    page = open_page(viewer(once(ON_THE_RIGHT, ON_THE_LEFT, NONE)))
    expect(page.locator("#stroke-3")).to_be_visible()
    pick(page, 1)
    right = outline(page)
    assert right["kind"] == "strip" and right["left"] == 3.0 and right["right"] == 13.5
    assert right["long"]["value"] == 6.0 and right["long"]["low"] < 6.0 < right["long"]["high"]
    assert abs(right["along"]) < 3  # the image shown first is the one over the lump
    page.wait_for_function("() => document.querySelector('#image').ariaLabel.includes('width not known')")
    pick(page, 2)
    left = outline(page)
    assert left["left"] == -15.0 and left["right"] == -4.5
    pick(page, 3)
    assert outline(page) is None


def test_the_outline_moves_with_the_lump_and_leaves_the_face_with_it(viewer, open_page):
    page = open_page(viewer(once(ON_THE_RIGHT)))
    expect(page.locator("#stroke-1")).to_be_visible()
    pick(page, 1)
    before = outline(page)["along"]
    page.locator("#scrub-range").focus()
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    assert outline(page)["along"] < before  # the probe has gone on
    page.keyboard.press("End")
    assert outline(page) is None


def test_a_lump_felt_by_all_columns_is_a_band_and_one_that_is_not_vouched_for_says_so(viewer, open_page):
    page = open_page(viewer(once(ALL_ACROSS, Bump(kind="outside", d_mm=23.0))))
    expect(page.locator("#stroke-2")).to_be_visible()
    pick(page, 1)
    band = outline(page)
    assert (band["kind"], band["left"], band["right"], band["sure"]) == ("band", -19.5, 19.5, True)
    pick(page, 2)
    assert outline(page)["sure"] is False
    page.wait_for_function("() => document.querySelector('#image').ariaLabel.includes('do not rely on it')")


def test_where_width_and_place_across_are_known_the_outline_is_closed(viewer, open_page):
    page = open_page(viewer(once()))
    lump = (
        "{along_mm: 2, d_mm: [12, 11, 13], columns_mm: [0, 9], across_mm: [5, 4, 6], width_mm: [8, 7, 10],"
        " sure: true}"
    )
    found = run(page, "outline.js", f"return [m.outline({lump}), m.words({lump})]")
    ring, words = found
    assert ring["kind"] == "ring" and ring["across"] == 5 and (ring["left"], ring["right"]) == (1, 9)
    assert ring["wide"] == {"value": 4, "low": 3.5, "high": 5}
    assert ring["between"] == [4, 6]
    assert words == [
        "12.0 mm along (11.0 to 13.0)", "8.0 mm across (7.0 to 10.0)", "middle at 5.0 mm across (4.0 to 6.0)",
    ]  # fmt: skip


def test_lifted_off_after_a_stroke_the_image_over_the_lump_is_shown_until_the_next_touch(viewer, open_page):
    source = once(ON_THE_RIGHT)
    source.lifts = True
    _, page = opened(viewer, open_page, source)
    expect(page.locator("#image-note")).to_have_text("stroke 1")
    found = outline(page)
    assert abs(found["along"]) < 1.5 and found["left"] == 3.0
    expect(page.locator("#image")).to_have_attribute("data-resting", "false")
    page.reload()
    expect(page.locator("#image-note")).to_have_text("stroke 1")
    assert outline(page) is not None
    source.halt_mm, source.limit = 0.0, 2
    expect(page.locator("#image-note")).to_have_text("")
    assert outline(page) is None
    source.halt_mm = None
    expect(page.locator("#image-note")).to_have_text("stroke 2")


# ---- the map


def test_strokes_stand_in_their_lanes_and_lumps_where_they_were_felt(viewer, open_page):
    source = once(ON_THE_RIGHT, ON_THE_LEFT, NONE)
    source.limit = 0
    running, page = opened(viewer, open_page, source)
    by_lanes(running, page, 0, 15)
    source.limit = 3
    expect(page.locator("#stroke-3")).to_be_visible()
    lumps = mapped(page, 1, 2, 3)
    assert sorted(lumps) == [1, 2]
    assert (lumps[1]["left"], lumps[1]["right"]) == (3.0, 13.5)
    assert (lumps[2]["left"], lumps[2]["right"]) == (0.0, 10.5)  # 15 mm on, and left of its line
    said = page.locator("#visit-map-list li")
    expect(said).to_have_count(3)
    expect(said.nth(0)).to_have_text("3, lane 30 mm: no lump found")
    expect(said.nth(1)).to_contain_text(
        "2, lane 15 mm: 9.0 mm (8.4 to 9.6), 7.2 mm deep, soft, width not known"
    )
    expect(page.locator("#lane-next")).to_have_value("45")
    expect(page.locator("#visit-map-order")).to_have_text("")
    page.keyboard.press("Escape")
    page.locator("#strokes").focus()
    page.keyboard.press("l")
    expect(page.locator("#visit-map")).to_be_hidden()
    expect(page.locator("#map")).to_be_visible()


def test_strokes_without_lanes_stand_in_their_order_and_the_page_says_so(viewer, open_page):
    source = once(ON_THE_RIGHT, ON_THE_LEFT, ON_THE_RIGHT)
    running, page = opened(viewer, open_page, source)
    expect(page.locator("#stroke-3")).to_be_visible()
    page.keyboard.press("l")
    lumps = mapped(page, 1, 2, 3)
    places = {(shape["across"], shape["along"]) for shape in lumps.values()}
    assert len(places) == 3
    expect(page.locator("#visit-map-order")).to_contain_text("in their order, not where they were")
    page.locator("#lanes-told").check()
    eventually(lambda: running.session.visits.lanes.told)  # else the next stroke may begin without a lane
    source.limit = 4
    expect(page.locator("#stroke-4")).to_be_visible()
    assert sorted(mapped(page, 1, 2, 3, 4)) == [4]
    expect(page.locator("#visit-map-order")).to_have_text("3 strokes without a lane are left out.")


def test_a_stroke_is_picked_on_the_map_and_by_its_line(viewer, open_page):
    source = once(ON_THE_RIGHT, ON_THE_LEFT)
    source.limit = 0
    running, page = opened(viewer, open_page, source)
    by_lanes(running, page, 0, 40)
    source.limit = 2
    expect(page.locator("#stroke-2")).to_be_visible()
    mapped(page, 1, 2)
    expect(page.locator("#lane-next")).to_have_value("80")  # it has a place on the map too
    click_on_strip(page, 1)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")
    expect(page.locator("#visit-map-list [aria-current]")).to_contain_text("1, lane 0 mm")
    page.locator("#visit-map-list li").first.click()
    expect(page.locator("#estimate-which")).to_contain_text("stroke 2,")


def test_a_line_more_below_the_map_leaves_it_as_high_as_it_is_shown(viewer, open_page):
    """Drawn before those words took their room it was stretched, and clicks counted beside what was seen."""

    def refuse(page):
        page.route("**/api/strip-2.json", lambda route: route.abort("connectionrefused"))

    source = once(ON_THE_RIGHT, ON_THE_LEFT)
    source.limit = 0
    running, page = opened(viewer, open_page, source, before=refuse)
    by_lanes(running, page, 0, 40)
    source.limit = 1
    expect(page.locator("#visit-map-list li")).to_have_count(1)
    mapped(page, 1)
    source.limit = 2
    expect(page.locator("#visit-map-list li")).to_have_count(2)
    settled(page)
    drawn, shown = page.locator("#visit-map").evaluate("(c) => [c.height, c.clientHeight * devicePixelRatio]")
    assert drawn == pytest.approx(shown, abs=1)
    click_on_strip(page, 1)
    expect(page.locator("#estimate-which")).to_contain_text("stroke 1,")


def test_another_visit_has_a_map_of_its_own_and_a_picked_stroke_shows_that_of_its_visit(viewer, open_page):
    source = once(ON_THE_RIGHT)
    _, page = opened(viewer, open_page, source)
    expect(page.locator("#stroke-1")).to_be_visible()
    page.keyboard.press("l")
    mapped(page, 1)
    new_visit(page, "in spring")
    expect(page.locator("#visit-map-note")).to_have_text("in spring")
    expect(page.locator("#visit-map-order")).to_contain_text("Strokes appear here")
    source.limit = 2
    expect(page.locator("#stroke-2")).to_be_visible()
    mapped(page, 2)
    page.locator("#stroke-1").click()
    expect(page.locator("#visit-map-note")).to_have_text("This visit")
    mapped(page, 1)


def test_what_is_typed_for_a_lane_is_not_undone_by_a_stroke_nor_by_a_late_answer(viewer, open_page):
    source = once(NONE, NONE)
    source.limit = 0
    running, page = opened(viewer, open_page, source)
    by_lanes(running, page, 10, 20)
    page.locator("#lane-next").fill("7")  # and still in the field
    source.limit = 1
    expect(page.locator("#stroke-1")).to_be_visible()
    settled(page)
    expect(page.locator("#lane-next")).to_have_value("7")
    with held(running, "lanes") as answer:
        page.keyboard.press("Enter")
        eventually(answer.arrived.is_set)
        source.limit = 2  # the second stroke goes to 7, and the next to 27, before the answer says 7
        expect(page.locator("#stroke-2")).to_be_visible()
        answer.let_go()
        expect(page.locator("#lane-next")).to_have_value("27")
    assert [s.lane_mm for s in running.session.visits.strokes()] == [10.0, 7.0]


def test_a_lane_that_means_nothing_is_not_taken(viewer, open_page):
    running, page = opened(viewer, open_page, once())
    by_lanes(running, page, 5, 20)
    page.locator("#lane-next").fill("")
    page.keyboard.press("Enter")
    expect(page.locator("#lane-next")).to_have_value("5")
    assert running.session.visits.lanes.next_mm == 5.0


def test_the_map_can_be_taken_away_as_a_picture(viewer, open_page):
    _, page = opened(viewer, open_page, once(ON_THE_RIGHT, ON_THE_LEFT))
    expect(page.locator("#stroke-2")).to_be_visible()
    page.keyboard.press("e")
    with page.expect_download() as download:
        page.get_by_text("Map of the visit as PNG").click()
    data = download.value.path().read_bytes()
    assert data.startswith(b"\x89PNG") and struct.unpack(">II", data[16:24]) == (1200, 800)
    assert download.value.suggested_filename == "visit-1.png"


def test_no_strokes_make_no_picture(viewer, open_page):
    _, page = opened(viewer, open_page, once())
    page.keyboard.press("e")
    page.get_by_text("Map of the visit as PNG").click()
    noticed(page, "There is no stroke to map yet.")


def test_a_strip_that_could_not_be_had_is_asked_for_again(viewer, open_page):
    refused = []

    def refuse_once(page):
        def take(route):
            if refused:
                return route.continue_()
            refused.append(route.request.url)
            return route.abort("connectionrefused")

        page.route("**/api/strip-*.json", take)

    _, page = opened(viewer, open_page, once(ON_THE_RIGHT), before=refuse_once)
    expect(page.locator("#stroke-1")).to_be_visible()
    with page.expect_event("requestfailed"):
        page.keyboard.press("l")
    settled(page)
    page.keyboard.press("l")
    page.keyboard.press("l")
    mapped(page, 1)


def test_where_lanes_overlap_each_strip_counts_by_how_near_its_middle_is(viewer, open_page):
    page = open_page(viewer(once()))
    found = run(
        page,
        "visit_map.js",
        """
        const strip = (rise) => ({ from_mm: 0, places: 3, columns: 26, rise_permille: Array(78).fill(rise) });
        const strokes = [{ lane_mm: 0, strip: strip(100) }, { lane_mm: 30, strip: strip(300) }];
        const box = m.extent(strokes);
        const { width, height, rise } = m.blend(strokes, box);
        const at = (mm) => rise[width + Math.floor(mm - box.left)];
        const seen = { alone: at(0), first: at(12), middle: at(15), second: at(18), last: at(40) };
        return { box, height, ...seen };
        """,
    )
    assert found["box"] == {"left": -19.5, "right": 49.5, "bottom": -0.5, "top": 2.5} and found["height"] == 3
    assert found["alone"] == pytest.approx(0.1) and found["last"] == pytest.approx(0.3)
    assert 0.1 < found["first"] < found["middle"] < found["second"] < 0.3
    assert found["middle"] == pytest.approx(0.2, abs=1e-6)


def test_labels_stand_over_no_other_and_are_left_out_where_there_is_no_room(viewer, open_page):
    page = open_page(viewer(once()))
    found = run(
        page,
        "visit_map.js",
        """
        const one = { x: 50, y: 50, sizes: [{ width: 40, height: 20 }], reach: { x: 5, y: 5 } };
        return m.placed([one, one, one, one, one], { left: 0, right: 120, top: 0, bottom: 100 });
        """,
    )
    assert found[0]["x"] == 59 and found[-1] is None
    shown = [place for place in found if place]
    assert 2 <= len(shown) <= 4 and len({(p["x"], p["y"]) for p in shown}) == len(shown)


def test_of_thirty_strokes_no_label_covers_a_strip_a_number_or_a_label_and_none_is_gone_unsaid(
    viewer, open_page
):
    bumps = [Bump(d_mm=12.1), Bump(kind="none"), Bump(d_mm=9.7, hardness="unsure", across_mm=11.0)]
    source = SyntheticSource(bumps, seconds=0.1, rest=0.0, limit=30)
    page = open_page(viewer(source), 900, 800)
    page.keyboard.press("l")
    wanted = " ".join(map(str, range(1, 31)))
    expect(page.locator("#visit-map")).to_have_attribute("data-strips", wanted)
    expect(page.locator("#visit-map-order")).to_contain_text("The newest 24 of 30 are drawn")
    settled(page)
    drawn, labels, words = (
        json.loads(page.locator("#visit-map").get_attribute(f"data-{name}"))
        for name in ("drawn", "labels", "words")
    )
    boxes = [box for box in labels if box] + words
    assert len(labels) == 16 and len([box for box in labels if box]) > 8

    def meet(a, b):
        return (
            a["x"] < b["x"] + b["width"]
            and b["x"] < a["x"] + a["width"]
            and a["y"] < b["y"] + b["height"]
            and b["y"] < a["y"] + a["height"]
        )

    assert not any(meet(a, b) for n, a in enumerate(boxes) for b in boxes[:n])
    strips = [
        {"x": s["left"], "y": s["top"], "width": s["right"] - s["left"], "height": s["bottom"] - s["top"]}
        for s in drawn
    ]
    assert all(sum(meet(box, strip) for strip in strips) == 1 for box in labels if box)


# ---- through the probe


@pytest.fixture(scope="module")
def solid():
    """A lump beside the line, on either side of it; and a cylinder."""
    lump = balls.clear_beside()
    cylinder = strokes_over(CYLINDER, "typical", balls.SEED, 60, 1, steady=True, press=True)[0]
    return lump, [balls.felt(lump, 60), balls.felt(lump, 60, turned=True), *cylinder], balls.calibration()


@pytest.fixture
def probe(solid, emulated):
    """A probe with the model that comes with Palpate; stroked again and again."""
    _, streams, calibration = solid
    given = {"public_key": emulator.public_key(), "model": emulator.image(models.BALLS), "repeat": True}
    return emulated(strokes=streams, calibration=calibration, **given)


def test_a_solid_lump_beside_the_line_is_drawn_beside_the_line_and_a_cylinder_all_across(
    probe, solid, viewer, open_page
):
    case = solid[0].case
    page = open_page(viewer(LiveSource(probe.port)))
    expect(page.locator("#stroke-3")).to_be_visible()
    shapes = []
    for number in (1, 2, 3):
        pick(page, number)
        shapes.append(outline(page))
    right, left, cylinder = shapes
    for ring, side in ((right, 1), (left, -1)):
        assert ring["kind"] == "ring" and ring["sure"]
        assert ring["between"][0] < side * case.offset_mm < ring["between"][1]
        assert ring["wide"]["low"] < case.half_axes_mm[1] < ring["wide"]["high"]
        assert ring["right"] - ring["left"] == pytest.approx(2 * ring["wide"]["value"])
        assert side * (ring["left"] + ring["right"]) / 2 > 0.8 * case.offset_mm
    assert cylinder["kind"] == "band"
    page.locator("#stroke-2").click()
    place = page.locator('#estimate [data-key="place_mm"]')
    expect(place).to_contain_text("Place across")
    expect(place).to_contain_text("\u2212")
    expect(page.locator('#estimate [data-key="width_mm"]')).to_contain_text("Width across")
    page.wait_for_function("() => document.querySelector('#image').ariaLabel.includes('mm across (')")
    page.keyboard.press("l")
    expect(page.locator("#visit-map-list")).to_contain_text("mm across, ")


def test_a_recording_shows_the_map_of_the_visit_that_it_is_of(probe, viewer, open_page, tmp_path):
    running = viewer(LiveSource(probe.port))
    # not from the keyboard: this probe strokes on and on, and each stroke moves what would be typed over
    running.session.set_lanes(True, -20.0, 17.5)
    page = open_page(running)
    expect(page.locator("#link-text")).to_have_text("Connected")
    page.locator("#strokes").focus()
    recording_begun(page)
    begun = page.locator("#strokes [data-number]").count()
    expect(page.locator(f"#stroke-{begun + 4}")).to_be_visible()
    recording_ended(page)
    (file,) = (tmp_path / "recordings").glob("*.mcap")
    live = {s.estimate.time_us: s.lane_mm for s in running.session.visits.strokes() if s.estimate}
    again = [s for s in load_strokes(file) if s.estimate and s.frames > 40]
    assert len(again) >= 3
    assert [s.lane_mm for s in again] == [live[s.estimate.time_us] for s in again]
    assert len({s.lane_mm for s in again}) == len(again)
    replayed = open_page(viewer(ReplaySource(file), mode="replay"))
    expect(replayed.locator("#link-text")).to_have_text("Played to its end")
    replayed.keyboard.press("l")
    expect(replayed.locator("#lane-next")).to_be_hidden()
    for stroke in again:
        lane = f"lane {stroke.lane_mm:g} mm".replace("-", "\u2212")
        expect(replayed.locator("#visit-map-list")).to_contain_text(lane)
    expect(replayed.locator("#ticks .mark")).to_have_count(0)  # a stroke's lane is no note of its reader's
