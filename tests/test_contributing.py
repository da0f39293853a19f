"""What surrounds the code says only what there is: CONTRIBUTING's table, hooks, workflow, container, recipe and metadata.

None of these is run by the tests of the package, so a name in them could go stale unnoticed.
"""

import ast
import functools
import json
import os
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from looping_pendulum import __version__

PROJECT = Path(__file__).parents[1]
CONTRIBUTING = (PROJECT / "CONTRIBUTING.md").read_text(encoding="utf-8")
WORKFLOW = ".github/workflows/ci.yml"
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
NAMED = re.compile(r"([\w./]+):(\w+)")
THINGS = [
    "an engine",
    "a claim about an engine",
    "an effect",
    "an error of the camera",
    "a metric",
    "a language of the live page",
    "a map column",
    "a reader of measured data",
]
YAML_FILES = sorted(
    path.relative_to(PROJECT).as_posix()
    for pattern in (".github/**/*.yml", ".binder/*.yml", ".pre-commit-config.yaml", "recipe/*.yaml", "CITATION.cff")
    for path in PROJECT.glob(pattern)
)


def section(title):
    return CONTRIBUTING.split(f"\n## {title}\n")[1].split("\n## ")[0]


def rows(text):
    """Cells of a table's rows, without its head."""
    table = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table[1:]]


@functools.cache
def top_level(file):
    """Names that a module defines or imports, read without running it."""
    names = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {each.id for target in node.targets for each in ast.walk(target) if isinstance(each, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        elif isinstance(node, ast.ImportFrom):
            names |= {each.asname or each.name for each in node.names}
    return names


def exists(named):
    """Whether there is such a path or ``module:name``."""
    match = NAMED.fullmatch(named)
    if not match:
        return (PROJECT / named).exists()
    place, name = match.groups()
    module = PROJECT.joinpath("looping_pendulum", *place.split("."))
    candidates = [PROJECT / place] if place.endswith(".py") else [module.with_suffix(".py"), module / "__init__.py"]
    return any(file.is_file() and name in top_level(file) for file in candidates)


def places(text):
    """Paths and ``module:name`` between backticks; other code has blanks, or neither slash nor suffix."""
    spans = re.findall(r"`([^`]+)`", text)
    files = r"[\w.-]+\.(toml|yml|yaml|md|py|cff|json)|Dockerfile|Makefile"
    return [s for s in spans if " " not in s and (NAMED.fullmatch(s) or "/" in s or re.fullmatch(files, s))]


def test_the_table_says_of_each_thing_where_it_goes():
    table = rows(section("Where to add what"))
    assert [row[0] for row in table if row[0] and set(row[0]) != {"-"}] == THINGS
    parts = section("Where to add what").split("\n| a")
    for part in parts[1:]:  # each has code, a test and a page
        assert {"tests/", "docs/"} <= {start for start in ("tests/", "docs/") for p in places(part) if p.startswith(start)}, (
            part
        )
    assert len(places(section("Where to add what"))) > 60


@pytest.mark.parametrize("title", ["Where to add what", "Around the code"])
def test_every_place_that_the_tables_name_exists(title):
    text = "\n".join(" | ".join(row) for row in rows(section(title)))
    lost = [named for named in dict.fromkeys(places(text)) if not exists(named)]
    assert not lost, "CONTRIBUTING.md names what is no longer there"


def test_a_place_that_is_gone_would_be_found():
    assert exists("compare.metrics:metrics")
    assert exists("docs/maps.md")
    for gone in ("compare.metrics:nothing", "compare.nothing:metrics", "docs/nothing.md", "tests/nothing.py:CASES"):
        assert not exists(gone), gone
        assert places(f"| a | `{gone}` |") == [gone]


def test_private_names_that_the_table_gives_beside_a_module_are_there():
    assert "`_summary`" in CONTRIBUTING
    assert "_summary" in top_level(PROJECT / "looping_pendulum" / "sweep/cells.py")


def test_links_lead_somewhere():
    for page in ("CONTRIBUTING.md", "CHANGELOG.md", "CODE_OF_CONDUCT.md", ".github/pull_request_template.md"):
        for target in re.findall(r"\]\(([^)\s]+)\)", (PROJECT / page).read_text(encoding="utf-8")):
            assert target.startswith("https://") or (PROJECT / target).exists(), f"{page}: {target}"


@pytest.mark.parametrize("file", YAML_FILES)
def test_yaml_is_yaml_without_a_key_given_twice(file):
    class Strict(yaml.SafeLoader):
        """PyYAML keeps the last of two equal keys and says nothing."""

    def mapping(loader, node):
        keys = [loader.construct_object(key) for key, _ in node.value]
        assert len(keys) == len(set(keys)), f"{file}: a key twice among {keys}"
        return dict(loader.construct_pairs(node, deep=True))

    Strict.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, mapping)
    assert yaml.load((PROJECT / file).read_text(encoding="utf-8"), Loader=Strict)


def loaded(file):
    return yaml.safe_load((PROJECT / file).read_text(encoding="utf-8"))


def commands():
    """Lines of the workflow's steps."""
    jobs = loaded(WORKFLOW)["jobs"].values()
    return [line for job in jobs for step in job["steps"] for line in step.get("run", "").splitlines()]


def targets():
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([\w-]+):", makefile, re.MULTILINE)) | {f".venv/{n}" for n in ("main", "test", "dev", "coverage")}


def test_what_the_workflow_the_container_and_the_hooks_call_is_there():
    container = (PROJECT / "Dockerfile").read_text(encoding="utf-8")
    run = [*commands(), *re.findall(r'(?:^RUN |"|&& )(make [^\n"&]+)', container, re.MULTILINE)]
    made = [word for line in run if line.startswith("make ") for word in line.split()[1:] if "=" not in word]
    assert {"lint", "test", "docs", "coverage", "compare"} <= set(made) <= targets()
    extras = [name for line in run for group in re.findall(r"\[([\w,]+)\]", line) for name in group.split(",")]
    assert set(extras) <= set(SETTINGS["project"]["optional-dependencies"])
    for line in run:
        for path in re.findall(r"\btests/[\w/]+\.py", line):
            assert (PROJECT / path).is_file(), line
    lint = next(part for part in (PROJECT / "Makefile").read_text(encoding="utf-8").split("\n\n") if part.startswith("lint:"))
    hooks = [hook for repo in loaded(".pre-commit-config.yaml")["repos"] if repo["repo"] == "local" for hook in repo["hooks"]]
    checks = re.findall(r"(?:\$\(BIN\)/|(?=npm run ))([^&,\n]+?)(?= &&|,|\n|$)", lint)
    assert checks[-1] == "npm run --silent check"
    assert [hook["entry"].removesuffix(" --fix").removeprefix(".venv/bin/") for hook in hooks] == [
        command.replace(" --check", "").removesuffix(" .") for command in checks
    ]


def test_the_tests_whose_coverage_is_measured_are_there():
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    covered = re.search(r"^COVERED = (.*)$", makefile, re.MULTILINE)[1]
    named = [start + end for start, ends in re.findall(r"\$\(addprefix ([^,]+),([^)]+)\)", covered) for end in ends.split()]
    assert len(named) > 20
    assert [name for name in ["tests/scenarios", *named] if not (PROJECT / name).exists()] == []
    for package in SETTINGS["tool"]["coverage"]["run"]["source_pkgs"]:
        place = PROJECT / package.replace(".", "/")
        assert place.is_dir() or place.with_suffix(".py").is_file(), package


def test_the_workflow_runs_the_versions_that_the_readme_promises():
    readme = (PROJECT / "README.md").read_text(encoding="utf-8")
    low, high = map(int, re.search(r"Python 3\.(\d+) to 3\.(\d+)", readme).groups())
    assert SETTINGS["project"]["requires-python"] == f">=3.{low}"
    jobs = loaded(WORKFLOW)["jobs"]
    assert jobs["test"]["strategy"]["matrix"]["python"] == [f"3.{minor}" for minor in range(low, high + 1)]
    assert loaded(".binder/environment.yml")["dependencies"][0] == f"python=3.{low}"
    assert f"FROM python:3.{low}-" in (PROJECT / "Dockerfile").read_text(encoding="utf-8")


def test_no_package_without_wheels_is_asked_for_elsewhere():
    markers = {
        re.match(r"\w+", line)[0]: line.partition(";")[2]
        for line in (*SETTINGS["project"]["dependencies"], *SETTINGS["project"]["optional-dependencies"]["test"])
    }
    for package in ("heyoka", "pybullet", "drake"):
        assert "sys_platform == 'linux' and platform_machine == 'x86_64'" in markers[package], package
    assert "sys_platform != 'darwin' or platform_machine == 'arm64'" in markers["mujoco"]


def test_zenodo_and_citation_say_the_same():
    citation = loaded("CITATION.cff")
    zenodo = json.loads((PROJECT / ".zenodo.json").read_text(encoding="utf-8"))
    assert [zenodo[key] for key in ("title", "version", "license")] == [
        citation[key] for key in ("title", "version", "license")
    ]
    assert [c["name"] for c in zenodo["creators"]] == [author["name"] for author in citation["authors"]]
    assert zenodo["version"] == __version__
    (paper,) = citation["references"]
    assert paper["title"] in zenodo["references"][0]
    assert all(author["family-names"] in zenodo["references"][0] for author in paper["authors"])


def test_the_recipe_asks_for_what_the_project_asks_for():
    recipe = loaded("recipe/recipe.yaml")
    assert recipe["context"]["version"] == __version__
    called = {"matplotlib": "matplotlib-base", "mujoco": "mujoco-python", "heyoka": "heyoka.py"}
    project = {}
    for line in SETTINGS["project"]["dependencies"]:
        name, bound = re.match(r"([\w-]+)(>=[\d.]+)", line).groups()
        project[called.get(name, name)] = bound
    conda = dict(line.split() for line in (*recipe["requirements"]["run"], *recipe["requirements"]["run_constraints"]))
    assert conda.pop("python") == SETTINGS["project"]["requires-python"]
    assert conda == project
    command, _, function = recipe["build"]["python"]["entry_points"][0].partition(" = ")
    assert SETTINGS["project"]["scripts"][command] == function


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such bit")
def test_binders_last_step_may_be_run():
    assert os.access(PROJECT / ".binder" / "postBuild", os.X_OK)
