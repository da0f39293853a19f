"""What a teacher shows: the demonstration page, demonstrations of modelling assumptions, new scenarios and studies."""
