"""A process that has imported and collected everything, and forks for each mutant: only the tests themselves take time.

A mutant inside a function is laid into the function that is already there, by its code object; one that changes what happens on
import (a constant, a decorator, a default) cannot be, and gets a process that imports it (`covering.ask`).
"""

import ast
import os
import sys
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import pytest

from tests.mutation import processes
from tests.mutation.covering import PYTEST, Limits
from tests.mutation.mutants import Mutant

NO_PLACE = 71
"""Status of a child that could not lay the mutant into what is there."""


@cache
def _functions(path: Path) -> list[tuple[str, int, int]]:
    """(dotted name, first and last line of the body) of every function of a file that is in no other function."""
    functions = []

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.FunctionDef):
                functions.append((prefix + node.name, node.body[0].lineno, node.end_lineno or 0))
            elif isinstance(node, ast.ClassDef):
                visit(node.body, f"{prefix}{node.name}.")

    visit(ast.parse(path.read_text(encoding="utf-8")).body, "")
    return functions


def enclosing_function(root: Path, mutant: Mutant) -> str:
    """Dotted name of the function whose body holds the mutant; empty if none does, or if it is not the only one of its name."""
    functions = _functions(root / mutant.path)
    names = [name for name, first, last in functions if first <= mutant.line <= last]
    return names[0] if len(names) == 1 and sum(name == names[0] for name, _, _ in functions) == 1 else ""


class Zygote:
    """Forks for mutants; stands in a process of its own, because what it imports is the copy's."""

    def __init__(self, copy: Path, tests: list[str], durations: dict[str, float], log: Path) -> None:
        from multiprocessing import Pipe

        self._ours, theirs = Pipe()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                self._ours.close()
                processes.become_child(copy, log)
                pytest.main([*PYTEST, *tests], plugins=[_Server(theirs, copy, durations)])
            finally:
                os._exit(0)
        theirs.close()
        self._ours.recv()  # everything is collected

    def ask(self, module: str, function: str, source: str, tests: list[str], limit: float, log: Path) -> tuple[int, float, str]:
        """Run ``tests`` with ``function`` as ``source`` has it; return what `covering.ask` does."""
        self._ours.send(
            {"module": module, "function": function, "source": source, "tests": tests, "limit": limit, "log": str(log)}
        )
        status, seconds, by = self._ours.recv()
        return status, seconds, by

    def close(self) -> None:
        self._ours.close()
        os.waitpid(self.pid, 0)


class _Server:
    """Pytest plugin: in place of the tests, answers requests until there are no more."""

    def __init__(self, connection: Connection, copy: Path, durations: dict[str, float]) -> None:
        self.connection, self.copy, self.durations = connection, copy, durations

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        items = {item.nodeid: item for item in session.items}
        processes.freeze()
        self.connection.send("ready")
        while True:
            try:
                asked = self.connection.recv()
            except EOFError:
                return True
            self.connection.send(self._answer(session, items, asked))

    def _answer(self, session: pytest.Session, items: dict[str, pytest.Item], asked: dict[str, Any]) -> tuple[int, float, str]:
        note = self.copy / "running"
        note.unlink(missing_ok=True)

        def work() -> int:
            from _pytest.main import pytest_runtestloop

            processes.forget_bytecode()
            session.items = [items[test] for test in asked["tests"]]
            session.testscollected = len(session.items)
            session.config.pluginmanager.register(Limits(self.durations, note))
            session.config._tmp_path_factory._given_basetemp = self.copy / "tmp"  # type: ignore[attr-defined]
            if asked["function"] and not lay(asked["module"], asked["function"], asked["source"]):
                return NO_PLACE
            try:
                pytest_runtestloop(session)
            except session.Failed:
                return 1
            return 1 if session.testsfailed else 0

        status, seconds = processes.run_child(self.copy, Path(asked["log"]), work, asked["limit"], fresh=False)
        return status, seconds, note.read_text() if note.exists() else ""


def lay(module: str, function: str, source: str) -> bool:
    """Give the function that is there the code that ``source`` has for it; False if it cannot be reached."""
    try:
        live = _live(module, function)
        code = _codes(compile(source, live.__code__.co_filename, "exec"))[function]
        same = live.__code__.co_qualname == function and live.__code__.co_firstlineno == code.co_firstlineno
        if same:
            live.__code__ = code
    except (AttributeError, KeyError, TypeError, ValueError):
        return False
    return same


def _live(module: str, function: str) -> FunctionType:
    target: Any = sys.modules[module]
    for name in function.split("."):
        target = vars(target)[name]
    while not isinstance(target, FunctionType):
        for wrapped in ("fget", "func", "__func__", "__wrapped__"):
            if hasattr(target, wrapped):
                target = getattr(target, wrapped)
                break
        else:
            raise TypeError(f"{module}.{function} is no function")
    while hasattr(target, "__wrapped__"):
        target = target.__wrapped__
    return target


def _codes(code: CodeType) -> dict[str, CodeType]:
    codes = {}
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            codes |= {inner.co_qualname: inner} | _codes(inner)
    return codes
