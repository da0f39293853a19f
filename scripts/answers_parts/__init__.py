"""The parts of `scripts/answers.py`: one module per group of summaries, the figures and the page."""
