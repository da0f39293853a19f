"""Scripts that show one claim about an engine to that engine's own users, without this package (docs/repro.md)."""
