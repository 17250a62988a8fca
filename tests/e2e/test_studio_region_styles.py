"""All numbers of a region's style in the studio: they are those of the film, at keys and between them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from pipeline.methods import method, parse_params
from pipeline.methods.multistyle.design import parse
from pipeline.methods.multistyle.design_fields import DesignFields
from pipeline.methods.multistyle.styles import FIELDS, STYLES, chosen_style
from tests.e2e.pages import FRAMES, HEIGHT, WIDTH, Watched, until
from tests.e2e.studio import choose_style, layer_of, open_project, saved, stored
from tests.waiting import HTTP

pytestmark = [pytest.mark.real("chromium"), pytest.mark.timeout(240)]

LAST = FRAMES - 1
PARAMS = {"style": "impressionism", "stroke_size": 1.5, "hue": 150.0, "layers": -1.0}
KEYS = [
    {"region": "rest", "frame": 0, "style": "pointillism", "set": {"hue": 170, "relief": 7}, "ease": "smooth"},
    {"region": "rest", "frame": 8, "set": {"hue": -170, "value": -0.5, "threshold": 90}},
]
BETWEEN = 5


def film_values(design: dict[str, Any], frame: int) -> dict[str, float]:
    """The style of everything else at a frame, as the film has it."""
    params = parse_params(method("multistyle"), PARAMS)
    checked = parse({"version": 1, **json.loads(json.dumps(design))})
    fields = DesignFields(checked, chosen_style(params), STYLES[params.style].technique, (WIDTH, HEIGHT), (12, 8))
    found = dict(zip(FIELDS, fields.table(frame)[0][0].tolist(), strict=True))
    return {**found, "hue": (found["hue"] + 180) % 360 - 180}


def technique(design: dict[str, Any], frame: int) -> np.ndarray[Any, Any]:
    params = parse_params(method("multistyle"), PARAMS)
    fields = DesignFields(
        parse({"version": 1, **design}), chosen_style(params), STYLES[params.style].technique, (WIDTH, HEIGHT), (12, 8)
    )
    return np.asarray(fields._interpolated(frame, fields._technique_vector)[0])


def shown_values(page: Page) -> dict[str, float]:
    """Values of the sliders, by the name of the number."""
    page.locator("summary", has_text="All settings of the style").click()
    sliders = HTTP.get(page.url.partition("/#")[0] + "/v1/methods/multistyle").json()["studio"]["sections"][0][
        "sliders"
    ]
    section = page.get_by_role("region", name="Style of everything else")
    found = {
        one["name"]: float(section.locator("label", has_text=one["title"]).locator("output").inner_text())
        for one in sliders
    }
    page.locator("summary", has_text="All settings of the style").click()
    return found


def go_to(page: Page, frame: int) -> None:
    page.keyboard.press("Home")
    for _ in range(frame):
        page.keyboard.press("ArrowRight")
    until(page, lambda: page.locator(".stage-canvas").get_attribute("data-frame") == str(frame))


def test_eleven_numbers_are_those_of_the_film_and_a_new_key_takes_those_of_its_time(
    watched: Watched, service: str, video: str
) -> None:
    page = watched.page
    design = {"keys": KEYS}
    project = open_project(page, service, video, "multistyle", frame=4, params=PARAMS, parts={"design": design})
    for frame in (0, 3, BETWEEN, 8, LAST):
        go_to(page, frame)
        found = shown_values(page)
        assert set(found) == set(FIELDS)
        assert found == pytest.approx(film_values(design, frame), abs=0.0051), frame
    go_to(page, BETWEEN)
    page.locator("summary", has_text="All settings of the style").click()
    page.get_by_role("slider", name="Brightness").first.fill("0.4")
    saved(page)
    changed = layer_of(stored(service, project))["design"]
    made = next(key for key in changed["keys"] if key["frame"] == BETWEEN)
    assert (made["ease"], made["set"]) == ("smooth", {"value": 0.4})
    assert list(changed["styles"]) == [made["style"]]
    expected = {**film_values(design, BETWEEN), "value": 0.4}
    assert film_values(changed, BETWEEN) == pytest.approx(expected, abs=1e-5)
    assert technique(changed, BETWEEN) == pytest.approx(technique(design, BETWEEN), abs=1e-5)
    assert HTTP.get(f"{service}/v1/projects/{project}/check").json()["errors"] == []
    page.keyboard.press("Escape")
    page.locator(".stage-canvas").focus()
    page.keyboard.press("Control+z")
    until(page, lambda: layer_of(stored(service, project))["design"] == design)
    choose_style(page, "Watercolor")
    saved(page)
    changed = layer_of(stored(service, project))["design"]
    made = next(key for key in changed["keys"] if key["frame"] == BETWEEN)
    assert made["style"] == "watercolor" and set(made["set"]) == {"hue", "relief"}
    assert "styles" not in changed or changed["styles"] == {}
    watched.check()


def test_a_key_is_dragged_on_the_curve(watched: Watched, service: str, video: str) -> None:
    page = watched.page
    project = open_project(page, service, video, "multistyle", params=PARAMS, parts={"design": {"keys": KEYS}})
    before = stored(service, project)
    page.get_by_label("Number in the plot").select_option(label="Brightness")
    expect(
        page.get_by_role("img", name="Brightness of everything else: 0.02 at frame 1, -0.5 at frame 9")
    ).to_be_visible()
    key = page.get_by_role("slider", name="Brightness at frame 9")
    box = key.bounding_box()
    assert box is not None
    at = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(at[0], at[1] - 15, steps=5)
    page.mouse.up()
    saved(page)
    dragged = layer_of(stored(service, project))["design"]["keys"][1]["set"]
    assert dragged["value"] > -0.45 and dragged["hue"] == -170
    page.keyboard.press("Control+z")
    until(page, lambda: stored(service, project) == before)
    key.focus()
    page.keyboard.press("ArrowUp")
    saved(page)
    assert layer_of(stored(service, project))["design"]["keys"][1]["set"]["value"] == pytest.approx(-0.45)
    watched.check()
