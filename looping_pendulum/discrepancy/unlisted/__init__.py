"""What no library lists: an unknown force, where it acts, and the formulas it may have."""
