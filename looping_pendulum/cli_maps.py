"""Commands for maps."""
