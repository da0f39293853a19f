"""The colour-blind can tell apart what the pages colour: by colours that differ for them, too, or by dashes and shapes."""

from itertools import combinations, pairwise

import numpy as np
import pytest

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import label, main_engines, styles
from looping_pendulum.pages.palette import COLOURS, DARK_COLOURS
from scripts.live_page import bundle
from tests.pages.colour_vision import VISIONS, contrast, oklab, smallest_distance
from tests.pages.live_page import settled

MIN_DISTANCE = 0.1
"""In Oklab: five times what one just sees there, 0.02 (CSS Color 4)."""
MIN_CONTRAST = 3.0
"""WCAG 2.2, AA, for what a picture needs to be understood."""

PALETTE = """() => {
  live.change();
  const style = getComputedStyle(document.documentElement);
  const names = { blue: "--run-0", orange: "--run-1", green: "--run-2", pink: "--run-3", yellow: "--run-4", sky: "--run-5",
    line: "--line", soft: "--soft", panel: "--panel" };
  const valueOf = ([name, property]) => [name, style.getPropertyValue(property).trim()];
  const colours = Object.fromEntries(Object.entries(names).map(valueOf));
  return {
    colours,
    arrows: Object.values(modules.ARROWS),
    plots: modules.KINDS.map(({ stacked, lines }) =>
      ({ stacked: Boolean(stacked), colours: lines.map(({ colour }) => colour) })),
    residuals: Object.entries(modules.COLOURS).map(([name, colour]) =>
      ({ name, colour, shape: modules.shapeOf(name) })),
    scale: [0, 0.2, 0.4, 0.6, 0.8, 1].map(modules.tint),
  };
}"""


EXPORTS = """
  export { ARROWS } from "./assets/arrows.js";
  export { tint } from "./assets/map.js";
  export { KINDS } from "./assets/plots.js";
  export { COLOURS, shapeOf } from "./assets/trial_panel.js";
"""


@pytest.fixture(params=["light", "dark"])
def palette(opened, esbuild, request):
    """What the live page draws in which colours, on a ground."""
    page = opened.page
    if page.evaluate("document.documentElement.dataset.theme") != request.param:
        page.click("#theme")
        settled(page)
    page.evaluate(bundle(EXPORTS, "--global-name=modules", "--footer:js=globalThis.modules = modules;"))
    return page.evaluate(PALETTE)


def hexadecimal(rgb):
    return "#" + "".join(f"{int(channel):02x}" for channel in rgb.removeprefix("rgb(").removesuffix(")").split())


def test_simulated_vision_keeps_greys_and_mixes_up_what_it_should():
    for vision in VISIONS:
        np.testing.assert_allclose(oklab("#808080", vision), oklab("#808080"), atol=1e-3)
    # Red and green of a traffic light, and two colours that the pages have
    assert np.linalg.norm(oklab("#00aa00") - oklab("#cc3300")) > 2.5 * smallest_distance("#00aa00", "#cc3300")
    assert smallest_distance(COLOURS[2], COLOURS[3]) < MIN_DISTANCE < np.linalg.norm(oklab(COLOURS[2]) - oklab(COLOURS[3]))


@pytest.mark.long
def test_arrows_differ_by_colour_dashes_or_heads(palette):
    colours = palette["colours"]
    for one, other in combinations(palette["arrows"], 2):
        apart = smallest_distance(colours[one["colour"]], colours[other["colour"]])
        assert apart >= MIN_DISTANCE or any(one.get(style) != other.get(style) for style in ("dash", "heads"))


def test_curves_and_areas_of_one_plot_differ_by_colour(palette):
    colours = palette["colours"]
    for plot in palette["plots"]:
        for one, other in combinations(plot["colours"], 2):
            assert smallest_distance(colours[one], colours[other]) >= MIN_DISTANCE, (one, other)
        if not plot["stacked"]:
            assert all(contrast(colours[one], colours["panel"]) >= MIN_CONTRAST for one in plot["colours"])


def test_points_of_a_trial_differ_by_colour_or_shape(palette):
    colours = palette["colours"]
    together = [point for point in palette["residuals"] if point["name"].endswith(("_x", "_y"))]
    assert len(together) == 4
    for one, other in combinations(together, 2):
        apart = smallest_distance(colours[one["colour"]], colours[other["colour"]])
        assert apart >= MIN_DISTANCE or one["shape"] != other["shape"], (one, other)


def test_the_scale_of_the_map_goes_from_dark_to_light_for_all(palette):
    scale = [hexadecimal(tint) for tint in palette["scale"]]
    for vision in VISIONS:
        assert np.all(np.diff([oklab(tint, vision)[0] for tint in scale]) > 0)
    assert all(smallest_distance(one, other) >= MIN_DISTANCE for one, other in pairwise(scale))


def test_where_nothing_halts_the_map_is_striped(opened, palette):
    seen = opened.page.evaluate("""() => new Promise((done) => {
      live.map.job += 1;  // what a worker still computes is for another map
      live.map.grids = [{ columns: 2, rows: 1, drops: [[NaN, 0.3]] }];
      live.map.range = [0.2, 0.4];
      live.map.draw(live.state);
      const { width, height } = live.map.canvas, context = live.map.canvas.getContext("2d");
      const shades = (x) => {
        const { data } = context.getImageData(x * width, 0.2 * height, 40, 40), found = new Set();
        for (let i = 0; i < data.length; i += 4) found.add(`${data[i]} ${data[i + 1]} ${data[i + 2]}`);
        return [...found];
      };
      done({ never: shades(0.3), halts: shades(0.7) });
    })""")
    assert len(seen["halts"]) == 1
    assert (
        max(smallest_distance(hexadecimal(one), hexadecimal(other)) for one, other in combinations(seen["never"], 2))
        >= MIN_DISTANCE
    )


@pytest.mark.parametrize("colours", [COLOURS, DARK_COLOURS], ids=["light", "dark"])
def test_the_main_engines_differ_by_colour_or_dashes(colours):
    shown = styles(label(engine) for engine in main_engines(Profile.QUICK)).values()
    for one, other in combinations(shown, 2):
        apart = smallest_distance(colours[one.slot], colours[other.slot])
        assert apart >= MIN_DISTANCE or (one.dashes != other.dashes and one.marker != other.marker)
