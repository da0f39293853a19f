"""A figure as data is the same on paper and on a page: bars, bands, spans, lines of two points, grids, words."""

import numpy as np
import pytest

from looping_pendulum.files import SkippedOutputWarning
from looping_pendulum.pages.chart import BLACK, Chart, ChartAxis, Curve, Guide, Panel, make_charts, with_room
from looping_pendulum.pages.drawing import draw
from looping_pendulum.pages.figures import MAX_LINE_POINTS, on_page


def chart(*panels, **fields):
    return Chart(
        **({"id": "f", "caption": "c", "subject": "s", "title": "t", "x": ChartAxis(), "size": (4.0, 3.0)} | fields),
        panels=panels,
    )


def panel(*curves, **fields):
    return Panel(**({"y": ChartAxis()} | fields), curves=curves)


def both(*curves, **fields):
    """Return the axes and the figure of the page of one panel."""
    one = chart(panel(*curves, **fields))
    return draw(one).axes[0], on_page(one)


def test_a_band_lies_about_its_line():
    line = Curve(label="a", x=[0.0, 1.0], y=[5.0, 7.0], width=1.0, band=np.array([1.0, 2.0]))
    axes, page = both(line)
    (band,) = axes.collections
    corners = {tuple(corner) for corner in band.get_paths()[0].vertices}
    assert {(0.0, 4.0), (0.0, 6.0), (1.0, 5.0), (1.0, 9.0)} <= corners
    low, high, own = page["traces"]
    assert (low["y"], high["y"], own["y"]) == ([4.0, 5.0], [6.0, 9.0], [5.0, 7.0])
    assert (high["fill"], high["fillcolor"]) == ("tonexty", "faint var(--reference)")
    assert [trace["showlegend"] for trace in page["traces"]] == [False, False, True]
    assert {trace["legendgroup"] for trace in page["traces"]} == {"a"}, "a click hides all three"


def test_a_line_across_may_be_the_middle_of_a_shaded_span():
    axes, page = both(guides=[Guide(x=1.0, half_width=2.0, colour=BLACK), Guide(y=10.0, half_width=3.0)])
    spans = [span.get_extents().transformed(axes.transData.inverted()) for span in axes.patches]
    assert (spans[0].x0, spans[0].x1) == pytest.approx((-1, 3))
    assert (spans[1].y0, spans[1].y1) == pytest.approx((7, 13))
    x_line, x_span, y_line, y_span = page["layout"]["shapes"]
    assert (x_line["x0"], x_line["x1"], x_line["line"]) == (1.0, 1.0, {"color": "var(--reference)", "width": 1})
    assert (x_span["type"], x_span["x0"], x_span["x1"], x_span["yref"]) == ("rect", -1.0, 3.0, "y domain")
    assert (y_line["y0"], y_line["line"]["dash"]) == (10.0, "dot")
    assert (y_span["y0"], y_span["y1"], y_span["xref"], y_span["layer"]) == (7.0, 13.0, "x domain", "below")


@pytest.mark.parametrize("count", [2, 2 * MAX_LINE_POINTS])
def test_every_two_points_have_a_line_of_their_own(count):
    """However many: if some were left out, as of a run, lines would join points of two pairs."""
    values = np.arange(count)
    axes, page = both(Curve(label="", x=values, y=-values, width=1.0, in_pairs=True))
    x = axes.lines[0].get_xdata()
    assert np.isnan(x[2::3]).all()
    np.testing.assert_array_equal(x[~np.isnan(x)], values)
    (trace,) = page["traces"]
    assert trace["x"][:3] == [0.0, 1.0, None]
    assert len(trace["x"]) == len(x) == count * 3 // 2
    assert (trace["showlegend"], trace["hoverinfo"]) == (False, "skip"), "it has no name"
    assert axes.get_legend_handles_labels() == ([], [])


def test_words_of_points_stand_beside_the_pointer():
    _, page = both(Curve(label="a", x=[1.0], y=[0.0], marker="o", words=["<b>"]), y=ChartAxis(ticks={0.0: "row"}))
    assert (page["traces"][0]["text"], page["traces"][0]["hovertemplate"]) == (["&lt;b&gt;"], "%{text}")


@pytest.mark.parametrize(("size", "sizing"), [(2.4, "constant"), (3.2, None)])
def test_a_legend_shows_no_point_too_small_to_see(size, sizing):
    _, page = both(Curve(label="a", x=[1.0], y=[0.0], marker="o", size=size))
    assert page["layout"].get("legend", {}).get("itemsizing") == sizing


def test_words_beside_an_axis_may_have_lines_and_no_markup():
    axes, page = both(y=ChartAxis(ticks={0.0: "$a$\n<b>"}, limits=(0.5, -0.5)))
    assert [label.get_text() for label in axes.get_yticklabels()] == ["\\$a\\$\n<b>"]
    assert page["layout"]["yaxis"]["ticktext"] == ["$a$<br>&lt;b&gt;"]


def test_panels_of_a_grid_have_axes_and_titles_of_their_own():
    point = Curve(label="a", x=[1.0], y=[2.0], marker="o")
    scaled = panel(point, title="<one>\nof $three$", to_scale=True)
    own = panel(point, title="two", x=ChartAxis(label="other", limits=(0.0, 9.0)), guides=[Guide(x=4.0, half_width=1.0)])
    grid = chart(scaled, own, panel(point, title="three"), columns=2, x=ChartAxis(label="shared"))
    figure = draw(grid)
    assert [axes.get_visible() for axes in figure.axes] == [True, True, True, False]
    first, second, third, _ = figure.axes
    assert [axes.get_title() for axes in (first, second)] == ["<one>\nof \\$three\\$", "two"]
    assert [axes.get_xlabel() for axes in (first, second, third)] == ["shared", "other", "shared"]
    assert (second.get_xlim(), first.get_xlim()[1] < 9) == ((0.0, 9.0), True)
    assert (first.get_aspect(), second.get_aspect()) == (1.0, "auto")
    assert figure.get_suptitle() == "s: t"
    page = on_page(grid)
    assert (page["layout"]["grid"]["rows"], page["layout"]["grid"]["columns"]) == (2, 2)
    assert [(trace["xaxis"], trace["yaxis"]) for trace in page["traces"]] == [("x", "y"), ("x2", "y2"), ("x3", "y3")]
    assert [page["layout"][name]["title"]["text"] for name in ("xaxis", "xaxis2", "xaxis3")] == ["shared", "other", "shared"]
    assert (page["layout"]["xaxis"]["scaleanchor"], page["layout"]["xaxis2"]["range"]) == ("y", [0.0, 9.0])
    assert not any("domain" in page["layout"][name] for name in ("yaxis", "yaxis2")), "the grid places them"
    assert [(shape["xref"], shape["yref"]) for shape in page["layout"]["shapes"]] == [("x2", "y2 domain")] * 2
    titles = [(words["text"], words["xref"]) for words in page["layout"]["annotations"]]
    assert titles == [("&lt;one&gt;<br>of $three$", "x domain"), ("two", "x2 domain"), ("three", "x3 domain")]


def test_charts_that_cannot_be_made_or_have_nothing_to_show_are_left_out():
    one = chart(panel())
    with pytest.warns(SkippedOutputWarning, match="figures/b.png is left out: ZeroDivisionError"):
        assert make_charts({"a": lambda: one, "b": lambda: 1 / 0, "c": lambda: None}) == [one]


def test_the_shorter_axis_is_at_least_half_as_long():
    assert with_room((0.0, 10.0), (2.0, 3.0)) == [(0.0, 10.0), (0.0, 5.0)]
