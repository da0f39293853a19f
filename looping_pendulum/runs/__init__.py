"""What any run is, of the reference, an engine or a fitted trial: its samples, events, tension and storage."""
