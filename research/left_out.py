"""Measure how often the search leaves out what it would name: `python -m research.left_out --seed 78 --share 0.5 --work DIR`.

Each blind study is judged twice: by the limits of `evidence.prior`, and by much wider ones, with which several times as many
explanations are fitted. What these find credible and the others did not even fit was left out.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from unittest import mock

from threadpoolctl import threadpool_limits

import looping_pendulum as lp
from looping_pendulum.discrepancy.evidence import search
from looping_pendulum.discrepancy.evidence.explain import Explanations, explain
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.files import write_atomically
from research import DATA, calibration
from research.calibration_summary import Outcome, proportion
from tests.discrepancy.blind_sample import BlindStudy, write_files

WIDE = {"MARGIN": 15.0, "LINEAR_ERROR": 0.5, "BEAM": 5}
"""Limit of `evidence.prior` -> its value with which hardly anything is left out."""
RESULT = DATA / "left_out.json"


def solve(study: BlindStudy) -> tuple[str, Outcome]:
    """Judge a study by both limits, and return its name and what was left out."""
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1, user_api="blas"):
        try:
            inputs = read_inputs(lp.load_study(write_files(study, Path(folder))))
        except ValueError as error:  # no value of the hidden number gives the size
            return study.name, {"unreachable": str(error)}
        try:
            usual, _ = explain(inputs)
            with mock.patch.multiple(search, **WIDE):
                wide, _ = explain(inputs)
        except Exception as error:
            return study.name, {"failed": repr(error)}
        if usual.interrupted or wide.interrupted:
            raise KeyboardInterrupt
    return study.name, outcome_of(usual, wide)


def outcome_of(usual: Explanations, wide: Explanations) -> Outcome:
    """Return what of the credible explanations by wide limits was not fitted by the usual ones, with its probability."""
    left_out = [key for key in wide.credible if key not in usual.search.tried]
    return {
        "left_out": [[sorted(key), wide.probabilities[key]] for key in left_out],
        "fitted": [len(usual.search.tried), len(wide.search.tried)],
    }


def main() -> None:
    """Judge the studies that the options ask for, and store how many lack something."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder in which finished studies are kept")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--share", type=float, default=0.5, help="share of 400 studies, such as 0.05")
    parser.add_argument("--seed", type=int, default=78, help="seed of the studies")
    options = parser.parse_args()
    outcomes, interrupted = calibration.run(calibration.drawn_studies(options), options.work, jobs=options.jobs, judge=solve)
    judged = {name: o for name, o in outcomes.items() if "left_out" in o}
    result = {
        "wide": WIDE,
        "command": f"python -m research.left_out --seed {options.seed} --share {options.share:g}",
        "judged": len(judged),
        "lacking": proportion(sum(bool(o["left_out"]) for o in judged.values()), len(judged)),
        "fitted": [sum(o["fitted"][i] for o in judged.values()) for i in (0, 1)],
        "left_out": {name: o["left_out"] for name, o in judged.items() if o["left_out"]},
    }
    # After Ctrl-C, too: the wide limits take minutes where two effects are hidden
    write_atomically(RESULT, json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1))
    if interrupted:
        sys.exit(130)


if __name__ == "__main__":
    main()
