"""Run many releases of one engine, each in an environment of its own, and name those in which a number moved."""
