"""How many faults do the tests catch? Seeded ones are put into the code, one at a time, and the tests run on each.

``python -m tests.mutation --sample 300 --seed 1 --only compare`` draws a sample, uniform over all mutants of the folder, and
states the share that a test catches with its 95 % interval. Cosmic Ray makes the mutants (`mutants`), coverage says which
tests run the changed line (`covering`), and each mutant gets a forked process with all third-party packages imported and a
copy of the project of its own (`processes`, `zygote`). Only the tests named in `FOLDERS` are asked, so the share is a lower
bound of what the whole suite catches.
"""

CONVENTIONS = "tests/test_conventions.py"
FOLDERS = {
    "compare": (
        (
            "looping_pendulum/compare",
            "looping_pendulum/pages/chart.py",
            "looping_pendulum/pages/drawing.py",
            "looping_pendulum/pages/figures.py",
            "looping_pendulum/engines/landmarks.py",
            "looping_pendulum/engines/string_motion.py",
        ),
        ("tests/compare", "tests/engines/test_string_motion.py", CONVENTIONS),
    ),
    "reference_ode": (("looping_pendulum/reference_ode",), ("tests/reference_ode", CONVENTIONS)),
    "fit": (("looping_pendulum/discrepancy/fit",), ("tests/discrepancy", CONVENTIONS)),
}
"""Name -> folders and files that are mutated, and the tests that must notice."""
