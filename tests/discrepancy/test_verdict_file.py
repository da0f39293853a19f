"""verdict.json is read back under the names of today, from today's version and from the one before."""

from __future__ import annotations

import dataclasses
import json

import pytest

from looping_pendulum.compare.json_text import plain
from looping_pendulum.discrepancy import result, verdict_file
from looping_pendulum.errors import ResultError
from tests.pages.made_up import identification

VERSION_2 = """{
  "schema": {"id": "looping-pendulum/identification", "version": 2},
  "study": "study",
  "effects": [{"name": "side_force", "value": 0.005, "null": 0.0}],
  "ties": [[{"name": "side_force", "null": 0.0}, {"name": "tilt", "null": 1.0}]],
  "unlisted": {
    "profiles": [{"side": "along", "sure_from": 0.1, "sure_to": 0.3, "written": [1.0, 2.0], "formula": "0.1 s"}],
    "formula": {
      "form": "pulse", "numbers": [{"name": "place", "value": 0.3}], "gain": 30.0, "gain_of_bumps": 20.0, "held_out": 1.0,
      "held_out_of_bumps": 1.1, "stands": true
    },
    "formulas": [{"gain": 30.0, "stands": true}],
    "gain": 100.0, "held_out_before": 3.0, "held_out_after": 1.0,
    "others": [{"acts_on": "heavy mass", "gain": 50.0, "held_out": 1.2}]
  },
  "remainder": {"rms": 0.1, "ratio": 2.0, "lasting": 4.0, "least": "the declared model"},
  "rounds": [{"errors_times": 2.0, "ranking": [{"name": "tilt", "gain": null, "held_out": null}]}],
  "errors": [{"trial": "first", "held_out": false, "noise_before": 1.5, "noise_after": 1.0}],
  "events": [{"trial": "first", "held_out": true, "before": 0.5, "after": null}],
  "before": {"numbers": [{"name": "mu"}], "condition": 10.0, "held_out": 3.0, "alarms": ["chi2"], "starts": [1.0]},
  "after": {"numbers": [], "condition": 11.0, "held_out": 1.0, "alarms": [], "starts": []}
}"""
VERSION_3 = {
    "study": "study",
    "effects": [{"name": "side_force", "value": 0.005, "null_value": 0.0}],
    "ties": [[{"name": "side_force", "null_value": 0.0}, {"name": "tilt", "null_value": 1.0}]],
    "unlisted": {
        "profiles": [
            {
                "side": "along",
                "significant_from": 0.1,
                "significant_to": 0.3,
                "fitted_formula_values": [1.0, 2.0],
                "formula": "0.1 s",
            }
        ],
        "formula": {
            "form": "pulse",
            "parameters": [{"name": "place", "value": 0.3}],
            "delta_bic": 30.0,
            "delta_bic_of_profile": 20.0,
            "held_out_chi2": 1.0,
            "held_out_chi2_of_profile": 1.1,
            "accepted": True,
        },
        "formulas": [{"delta_bic": 30.0, "accepted": True}],
        "twice_log_bayes_factor": 100.0,
        "held_out_chi2_before": 3.0,
        "held_out_chi2_after": 1.0,
        "other_closures": [{"acts_on": "heavy mass", "twice_log_bayes_factor": 50.0, "held_out_chi2": 1.2}],
    },
    "remainder": {"rms": 0.1, "ratio": 2.0, "lasting": 4.0, "least": "the declared model"},
    "rounds": [{"errors_times": 2.0, "ranking": [{"name": "tilt", "delta_bic": None, "held_out_chi2": None}]}],
    "errors": [{"trial": "first", "held_out": False, "standardised_rms_before": 1.5, "standardised_rms_after": 1.0}],
    "events": [{"trial": "first", "held_out": True, "before": 0.5, "after": None}],
    "before": {
        "parameters": [{"name": "mu"}],
        "condition_number": 10.0,
        "held_out_chi2": 3.0,
        "failed_tests": ["chi2"],
        "start_costs": [1.0],
    },
    "after": {"parameters": [], "condition_number": 11.0, "held_out_chi2": 1.0, "failed_tests": [], "start_costs": []},
}


def test_a_file_of_today_is_read_as_it_was_written():
    made_up = identification("a name")
    assert verdict_file.load(verdict_file.dump(made_up)) == plain(made_up)


def test_a_file_of_version_2_is_read_under_the_names_of_version_3():
    assert verdict_file.load(VERSION_2) == VERSION_3


@pytest.mark.parametrize("version", [3, 4, 5, 6])
def test_a_file_of_a_version_between_is_read_as_it_is(version):
    text = json.dumps({"schema": {"id": "looping-pendulum/identification", "version": version}, "seed": 3})
    assert verdict_file.load(text) == {"seed": 3}


def test_every_new_name_is_a_field_of_today():
    classes = [c for c in vars(result).values() if isinstance(c, type) and dataclasses.is_dataclass(c)]
    fields = {field.name for each in classes for field in dataclasses.fields(each)}
    assert {new for names in verdict_file.RENAMED.values() for new in names.values()} <= fields


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "verdict.json: Expecting property name"),
        ("[]", "schema: found 'None', needed the id 'looping-pendulum/identification'"),
        ('{"schema": {"id": "looping-pendulum/result", "version": 3}}', "needed the id 'looping-pendulum/identification'"),
        ('{"schema": {"id": "looping-pendulum/identification", "version": 9}}', "found version '9', needed 2 to 8"),
    ],
)
def test_what_is_no_verdict_file_is_refused(text, message):
    with pytest.raises(ResultError) as error:
        verdict_file.load(text)
    assert message in str(error.value)
