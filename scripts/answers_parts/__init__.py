"""The modules of `scripts/answers.py`: one for each group of summaries, one for the figures and one for the page."""
