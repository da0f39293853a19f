"""What the chain engines share, against geometry."""

import math

import pytest

from looping_pendulum.engines.chain import SlipGauge, hanging_rest_length, polygon_radius

RADIUS, BEND, TURN = 6.25e-3, 0.28, 3.5 * math.pi
LINK = RADIUS * BEND
NODE_RADIUS = polygon_radius(RADIUS, BEND)


def chain_slid_by(slip, hanging=0.03, free=0.2):
    """Return nodes one link apart on a rod that is wound almost twice, from light to heavy mass, and the links' lengths."""
    arcs = [LINK * i - slip for i in range(-400, 400)]  # from the tangent point on the heavy side, up along the string
    wound = [a for a in arcs if 0.0 <= a <= RADIUS * TURN]
    on_rod = [(NODE_RADIUS * math.cos(a / RADIUS), NODE_RADIUS * math.sin(a / RADIUS)) for a in wound]
    x, y = on_rod[-1]
    light = (x + free * math.sin(TURN), y - free * math.cos(TURN))
    places = [(RADIUS, -hanging - slip), *on_rod, light][::-1]
    # The string above its first node keeps its length as it slides; what hangs grows by what left the rod.
    lengths = [free, *[LINK] * (len(on_rod) - 1), hanging + slip + wound[0]]
    return places, lengths


@pytest.mark.parametrize("slip", [1e-6, 0.3 * LINK, 0.9999 * LINK, 7.5 * LINK, -2.2 * LINK])
def test_slip_is_what_the_string_moved_though_nodes_pass_and_it_is_wound_more_than_once(slip):
    # Oracle: the shift the chain was laid with. Bound: R bend^3, the polygon's part, at either reading.
    gauge = SlipGauge()
    assert gauge.read(*chain_slid_by(0.0)) == 0.0
    assert gauge.read(*chain_slid_by(slip)) == pytest.approx(slip, abs=2 * RADIUS * BEND**3)


def test_stretch_is_no_slip():
    # Oracle: where all is a tenth longer, the same point of the string passes the rod's side.
    places, lengths = chain_slid_by(0.3 * LINK)
    stretched = [(1.1 * x, 1.1 * y) for x, y in places]
    assert hanging_rest_length(stretched, lengths) == pytest.approx(hanging_rest_length(places, lengths), rel=1e-12)


def test_a_heavy_mass_at_the_rod_tells_no_slip():
    places, lengths = chain_slid_by(0.0)
    *upper, (x, _) = places
    assert math.isnan(hanging_rest_length([*upper, (x, 0.0)], lengths))
