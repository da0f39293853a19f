"""Nine demonstrations of what each model assumes: scripts to read, run, copy and change. `runner` runs them."""
