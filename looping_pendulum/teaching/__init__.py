"""What a teacher shows: the demonstration page, demonstrations of modelling assumptions, a new scenario by asking."""
