"""The comparison of both ways to explain a study: one rule judges both, and the tables say what they differ on."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks import explanations
from benchmarks.blind_sample import draw, planted_values
from benchmarks.explanations import judgement, summary, truth

DRAG, WIND = frozenset({"light_linear_drag"}), frozenset({"wind_speed"})
THRUST, BRAKE = ("light mass", "time"), ("heavy mass", "hanging_length")
NOTHING = (frozenset(), None)


@pytest.mark.parametrize(
    ("found", "right", "word"),
    [
        ([], NOTHING, "right"),
        ([NOTHING], NOTHING, "right"),
        ([(DRAG, None)], NOTHING, "wrong"),
        ([(DRAG, None)], (DRAG, None), "right"),
        ([(DRAG, None), (WIND, None)], (DRAG, None), "tied"),
        ([(WIND, None), NOTHING], (DRAG, None), "none"),
        ([(WIND, None)], (DRAG, None), "wrong"),
        ([(DRAG, None)], (DRAG | WIND, None), "part"),
        ([(frozenset(), THRUST)], (frozenset(), THRUST), "right"),
        ([(frozenset(), BRAKE)], (frozenset(), THRUST), "law"),
        ([(frozenset(), BRAKE)], (DRAG, None), "wrong"),
        ([(DRAG, BRAKE)], (DRAG, THRUST), "law"),
        ([(DRAG, None)], (DRAG, THRUST), "part"),
        ([(frozenset(), THRUST), (DRAG, THRUST)], (DRAG, THRUST), "tied"),
    ],
)
def test_a_set_of_explanations_is_judged_by_the_planted_one(found, right, word):
    assert judgement(found, right) == word


def test_the_truth_of_a_mixed_study_is_its_effect_and_its_law():
    study = dataclasses.replace(draw("rates", "mixed", 1, 0)[0], hidden=("linear_drag", "brake"), size=16e-3)
    assert truth(study) == (DRAG, BRAKE)
    assert set(planted_values(study)) == DRAG


def test_the_tables_show_what_both_methods_say():
    study = dataclasses.replace(draw("rates", "mixed", 1, 0)[0], hidden=("linear_drag", "brake"), size=16e-3)
    said = {
        "identify": {"explanations": [[["light_linear_drag"], None]], "judgement": "part", "cpu_seconds": 9.0},
        "evidence": {"explanations": [[["light_linear_drag"], list(BRAKE)]], "judgement": "right", "cpu_seconds": 3.0},
        "probabilities": [[["light_linear_drag", "law: heavy mass by hanging_length times retreat_speed"], 0.97], [[], 0.03]],
        "passes": True,
    }
    text = summary([(study, said)])
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    assert any(row[1:4] == ["mixed", "evidence", "1"] for row in cells)
    assert "holds the truth in 1 of 1 studies" in text
    assert "right: light_linear_drag+law of the heavy mass by hanging_length" in text
    assert [explanations._parts(key) for key, _ in said["probabilities"]] == [(DRAG, BRAKE), NOTHING]
