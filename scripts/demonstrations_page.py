"""The gallery of demonstrations: one page, docs/demonstrations/index.md, and pictures. `scripts.written_pages` writes it."""

from pathlib import Path

from looping_pendulum.demonstrations.runner import LEAD, DemonstrationRun, demonstrations, run_demonstration

FOLDER = Path(__file__).parents[1] / "docs" / "demonstrations"


def section(run: DemonstrationRun) -> str:
    """Return one demonstration as Markdown."""
    one = run.demonstration
    question, guess, experiment, change = (one.words[name] for name in ("Question", "Guess", "Experiment", "Change it"))
    return f"""## {one.title} {{#{one.name}}}

**Question.** {question}

**A guess.** {guess} What is yours?

**Experiment.** {experiment}

<details markdown="1"><summary>What came of it</summary>

```text
{run.printed}
```

![{run.caption}]({one.picture})

</details>

**Change it.** {change}

<details markdown="1"><summary>The script, {one.script.name}</summary>

```python
{one.source.rstrip()}
```

</details>
"""


def markdown(runs: list[DemonstrationRun]) -> str:
    """Return the page."""
    sections = "\n".join(map(section, runs))
    return f"""# What each model assumes

{LEAD}

```sh
looping-pendulum demonstrations polygon --out demonstrations
python demonstrations/04_polygon.py
```

The first runs one of them, or all if none is named, and leaves its script, its picture and a page in the folder. The second
runs the script alone, with whatever was changed in it.

{sections}"""


def write() -> None:
    """Run all and write the gallery; end the program if a claim does not hold."""
    FOLDER.mkdir(exist_ok=True)
    runs = [run_demonstration(one, FOLDER) for one in demonstrations()]
    for run in runs:
        if run.false_claim:
            raise SystemExit(f"{run.demonstration.name}: not borne out by this run: {run.false_claim}")
    (FOLDER / "index.md").write_text(markdown(runs), encoding="utf-8")
