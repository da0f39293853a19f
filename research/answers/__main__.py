"""Write the answers to the paper's open questions: `research/answers.md`, its figures, and the summaries behind them.

    python -m research.answers                       # redraw the figures and the page from the committed summaries
    python -m research.answers --rebuild             # compute all summaries again first (takes minutes)
    python -m research.answers --rebuild growth      # only this one

Every number on the page comes from a summary in `research/data/answers`, and every summary from runs of the reference.
"""

import argparse
import time

from research.answers import boundaries, common, figures, page, precision, questions

SUMMARIES = {
    compute.__name__: compute
    for compute in (
        *(precision.four_angles, precision.plain_programs, boundaries.growth, boundaries.near_75, boundaries.along_the_angle),
        *(boundaries.family, boundaries.exponents, questions.halting_map, questions.lowest_ratio, questions.mass_scale),
        questions.friction_and_radius,
    )
}
"""Name of a summary -> the function that computes it."""


def main() -> None:
    """Compute the requested summaries; then draw the figures and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    known = ", ".join(SUMMARIES)
    parser.add_argument("--rebuild", nargs="*", metavar="SUMMARY", help=f"compute again: {known}; all if none is named")
    args = parser.parse_args()
    names = [] if args.rebuild is None else args.rebuild or list(SUMMARIES)
    for name in names:
        if name not in SUMMARIES:
            parser.error(f"--rebuild: found {name!r}, needed one of {known}")
    for name in names:
        start = time.process_time()
        common.write(name, SUMMARIES[name]())
        print(f"{name}: {time.process_time() - start:.0f} CPU s")
    for figure in figures.draw():
        print(figure)
    common.PAGE.write_text(page.render())
    print(common.PAGE)


if __name__ == "__main__":
    main()
