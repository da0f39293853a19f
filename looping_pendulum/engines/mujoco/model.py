"""Compile MuJoCo models, also by older releases, which `looping-pendulum versions` compares with the newest."""

from __future__ import annotations

from typing import Any

NEWER_ATTRIBUTES = {"autoreset": ' autoreset="disable"', "simple": ' simple="auto"'}
"""Attribute that older releases refuse -> what stands in our models and is left out for them.

Without autoreset, MuJoCo goes on from the first state after a breakdown; the rigs read its warning of that. The other says what
those releases do anyway.
"""


def compile_model(mujoco: Any, xml: str) -> Any:
    """Return the compiled model of ``xml``, for a release that does not know them without the `NEWER_ATTRIBUTES`.

    Raises
    ------
    ValueError
        What MuJoCo finds wrong with it.
    """
    while True:
        try:
            return mujoco.MjModel.from_xml_string(xml)
        except ValueError as error:
            refused = [text for name, text in NEWER_ATTRIBUTES.items() if f"attribute: '{name}'" in str(error) and text in xml]
            if not refused:
                raise
            xml = xml.replace(refused[0], "")
