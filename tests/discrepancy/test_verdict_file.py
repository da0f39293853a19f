"""verdict.json is read back as it was written, and no other file is."""

from __future__ import annotations

import pytest

from looping_pendulum.compare.json_text import plain
from looping_pendulum.discrepancy import verdict_file
from looping_pendulum.errors import ResultError
from tests.pages.made_up import identification


def test_a_file_is_read_as_it_was_written():
    made_up = identification("a name")
    assert verdict_file.load(verdict_file.dump(made_up)) == plain(made_up)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "verdict.json: Expecting property name"),
        ("[]", "schema: found 'None', needed the id 'looping-pendulum/identification'"),
        ('{"schema": {"id": "looping-pendulum/result", "version": 9}}', "needed the id 'looping-pendulum/identification'"),
        ('{"schema": {"id": "looping-pendulum/identification", "version": 8}}', "found version '8', needed 9; write it again"),
        (
            '{"schema": {"id": "looping-pendulum/identification", "version": 10}}',
            "found version '10', needed 9; write it again",
        ),
        ('{"schema": {"id": "looping-pendulum/identification"}}', "found version 'None', needed 9; write it again"),
    ],
)
def test_what_is_no_verdict_file_is_refused(text, message):
    with pytest.raises(ResultError) as error:
        verdict_file.load(text)
    assert message in str(error.value)
