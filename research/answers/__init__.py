"""The modules of `python -m research.answers`: one for each group of summaries, one for the figures and one for the page."""
