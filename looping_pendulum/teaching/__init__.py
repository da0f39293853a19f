"""What a teacher shows: the demonstration page, new scenarios and studies."""
