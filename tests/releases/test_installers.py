"""How releases are listed and installed, by what pip and uv print; nothing here asks an index."""

import subprocess
import sys
import threading
import time
import zipfile

import pytest
from packaging.version import Version

from looping_pendulum.engines.mujoco.model import compile_model
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.errors import EngineError
from looping_pendulum.releases import installers
from looping_pendulum.releases.installers import (
    InstallationStopped,
    ReleaseError,
    install,
    list_releases,
    one_line,
    run_command,
)
from looping_pendulum.releases.study import chosen_releases, chosen_variants

LISTED = """WARNING: pip index is currently an experimental command.
mujoco (4.0.0)
Available versions: 4.0.0, 3.10.0, 3.9.0, 2004d, 2.3.1.post1
  INSTALLED: 4.0.0
"""
NO_NETWORK = """WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError'
ERROR: No matching distribution found for mujoco
"""
UNKNOWN = "ERROR: No matching distribution found for mujoco\n"
UV_NO_WHEEL = """error: No solution found when resolving dependencies
  cause: Because mujoco==2.2.0 has no usable wheels and you require mujoco==2.2.0, we can conclude that it cannot be.

hint: Wheels are required for `mujoco`
"""
UV_NO_WHEEL_OLDER = """  × No solution found when resolving dependencies:
  ╰─▶ Because mujoco==2.2.0 has no usable wheels and you require mujoco==2.2.0, we can conclude that it cannot be.
"""
PIP_NO_WHEEL = """ERROR: Could not find a version that satisfies the requirement mujoco==2.2.0 (from versions: 2.3.2, 2.3.3)
ERROR: No matching distribution found for mujoco==2.2.0
"""
AVAILABLE = tuple(map(Version, ("2.2.0", "3.1.0", "3.2.0", "3.10.0", "4.0.0")))


@pytest.fixture
def programs(monkeypatch):
    """Stand in for pip and uv: (words of a command) -> its exit status and output; the commands are recorded."""
    commands = []

    def use(*answers):
        def run(command, time_limit, cancelled=None):
            commands.append(list(command))
            return next((answer for words, *answer in answers if set(words) <= set(command)), (0, ""))

        monkeypatch.setattr(installers, "run_command", run)
        monkeypatch.setattr(installers, "uv", lambda: "uv")
        monkeypatch.setattr(installers, "_has_pip", lambda: True)
        return commands

    return use


def test_releases_are_listed_oldest_first_by_their_numbers(programs):
    commands = programs((("index",), 0, LISTED))
    assert list(map(str, list_releases("mujoco"))) == ["2.3.1.post1", "3.9.0", "3.10.0", "4.0.0"]
    assert commands[0][-1] == "mujoco"


def test_without_pip_uv_runs_one(programs, monkeypatch):
    commands = programs((("index",), 0, LISTED))
    monkeypatch.setattr(installers, "_has_pip", lambda: False)
    assert list_releases("mujoco")
    assert commands[0][:3] == ["uv", "tool", "run"]
    monkeypatch.setattr(installers, "uv", lambda: None)
    with pytest.raises(ReleaseError, match="found neither pip nor uv"):
        list_releases("mujoco")


@pytest.mark.parametrize(
    ("text", "words"), [(NO_NETWORK, "is there a network"), (UNKNOWN, "offers no release to this Python: No matching")]
)
def test_an_index_that_does_not_answer_is_told_from_one_without_the_package(programs, text, words):
    programs((("index",), 1, text))
    with pytest.raises(ReleaseError, match=words):
        list_releases("mujoco")


@pytest.mark.parametrize("text", [UV_NO_WHEEL, UV_NO_WHEEL_OLDER])
def test_an_installers_message_becomes_its_reason_in_one_line(text):
    assert one_line(text) == "mujoco==2.2.0 has no usable wheels"
    assert one_line(PIP_NO_WHEEL) == "Could not find a version that satisfies the requirement mujoco==2.2.0"
    assert one_line("") == "no message"


def test_pip_installs_where_uv_cannot_and_wheels_only(programs, tmp_path):
    commands = programs((("uv", "pip"), 1, UV_NO_WHEEL))
    python = install(tmp_path / "env", ["mujoco==3.1.0", "numpy<2"])
    assert python.startswith(str(tmp_path))
    assert [command[:4] for command in commands[2:]] == [
        [sys.executable, "-m", "venv", "--clear"],
        [sys.executable, "-m", "pip", "--python"],
    ]
    for command in (commands[1], commands[3]):
        assert command[-4:] == ["--only-binary", ":all:", "mujoco==3.1.0", "numpy<2"]
        assert python in command


def test_where_neither_can_install_uvs_reason_is_told_and_nothing_stays(programs, tmp_path):
    programs((("uv", "pip"), 1, UV_NO_WHEEL), (("--python", "install"), 1, PIP_NO_WHEEL))
    (tmp_path / "env").mkdir()
    with pytest.raises(ReleaseError, match=r"^mujoco==2.2.0 has no usable wheels$"):
        install(tmp_path / "env", ["mujoco==2.2.0"])
    assert not (tmp_path / "env").exists()


@pytest.mark.long
def test_a_cancelled_installer_is_killed(tmp_path):
    cancelled, mark = threading.Event(), tmp_path / "alive"
    threading.Timer(0.3, cancelled.set).start()
    code = f"import time; time.sleep(3); open({str(mark)!r}, 'w')"
    with pytest.raises(InstallationStopped):
        run_command([sys.executable, "-c", code], 60.0, cancelled)
    time.sleep(3.5)
    assert not mark.exists()


def test_an_installer_has_a_time_limit():
    with pytest.raises(ReleaseError, match=r"no end within 0.3 s"):
        run_command([sys.executable, "-c", "import time; time.sleep(60)"], 0.3)


@pytest.mark.long
@pytest.mark.parametrize("without_uv", [False, True])
def test_an_environment_has_what_was_asked_for_and_nothing_of_ours(without_uv, tmp_path, monkeypatch):
    if without_uv:
        monkeypatch.setattr(installers, "uv", lambda: None)
    wheel = tmp_path / "tiny-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as file:
        file.writestr("tiny.py", "")
        file.writestr("tiny-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n")
        file.writestr("tiny-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        names = ["tiny.py", *(f"tiny-1.0.dist-info/{name}" for name in ("METADATA", "WHEEL", "RECORD"))]
        file.writestr("tiny-1.0.dist-info/RECORD", "".join(f"{name},,\n" for name in names))
    python = install(tmp_path / "env", [str(wheel)])
    done = subprocess.run([python, "-P", "-c", "import tiny; import numpy"], capture_output=True, text=True, env={})
    assert "No module named 'numpy'" in done.stderr


def test_releases_are_chosen_from_a_range_or_a_list():
    def chosen(**options):
        return list(map(str, chosen_releases("mujoco", AVAILABLE, **options)))

    assert chosen(first="3.1", last="3.10") == ["3.1.0", "3.2.0", "3.10.0"]
    assert chosen(first="3.5") == ["3.10.0", "4.0.0"]
    assert chosen(last="3") == ["2.2.0"]
    assert chosen(listed="3.10.0, 3.1.0") == ["3.1.0", "3.10.0"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "needed --from V, --to V or --versions V,W; mujoco: it has 5 releases, 2.2.0 to 4.0.0"),
        ({"listed": "3.1.9"}, "mujoco has no release 3.1.9; near it are 3.1.0"),
        ({"listed": "3.1.0", "first": "3"}, "leave one out"),
        ({"listed": ","}, "found no version"),
        ({"first": "new"}, "--from: found 'new', needed a version"),
        ({"first": "5", "last": "6"}, "no release from 5 to 6"),
    ],
)
def test_a_release_that_does_not_exist_is_one_line_with_a_way_out(options, words):
    with pytest.raises(ReleaseError) as error:
        chosen_releases("mujoco", AVAILABLE, **options)
    assert words in str(error.value)


def test_main_variants_are_chosen_and_all_where_none_is_main():
    quick = Profile.QUICK
    assert [e.variant for e in chosen_variants("mujoco", (), quick)] == ["documented", "capstan", "beads"]
    assert [e.variant for e in chosen_variants("mujoco", ("drum", "mujoco:capstan"), quick)] == ["capstan", "drum"]
    assert [e.variant for e in chosen_variants("pybullet", (), quick)] == ["chain"]
    with pytest.raises(EngineError, match="did you mean 'mujoco'"):
        chosen_variants("mujco", (), quick)
    with pytest.raises(EngineError, match="mujoco has no variant 'rope'; it has documented"):
        chosen_variants("mujoco", ("rope",), quick)
    with pytest.raises(EngineError, match="no engine is called 'reference'"):
        chosen_variants("reference", (), quick)


class OlderMujoco:
    """MuJoCo of a release that knows some attributes only."""

    def __init__(self, *unknown: str) -> None:
        self.unknown, self.MjModel, self.compiled = unknown, self, []

    def from_xml_string(self, xml):
        self.compiled.append(xml)
        for name in self.unknown:
            if f" {name}=" in xml:
                raise ValueError(f"XML Error: Schema violation: unrecognized attribute: '{name}'\nElement 'x', line 6")
        return xml


def test_an_older_mujoco_gets_a_model_without_the_attributes_that_it_refuses():
    xml = '<flag contact="disable" autoreset="disable"/><body simple="auto"/>'
    assert compile_model(OlderMujoco("autoreset", "simple"), xml) == '<flag contact="disable"/><body/>'
    assert compile_model(OlderMujoco("autoreset"), xml) == '<flag contact="disable"/><body simple="auto"/>'
    newest = OlderMujoco()
    assert compile_model(newest, xml) == xml
    assert newest.compiled == [xml]
    # What changes the physics is never left out
    with pytest.raises(ValueError, match="'simple'"):
        compile_model(OlderMujoco("simple"), '<body simple="false"/>')
    with pytest.raises(ValueError, match="'contact'"):
        compile_model(OlderMujoco("contact"), xml)
