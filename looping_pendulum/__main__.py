"""Run the command line as `python -m looping_pendulum`."""

from looping_pendulum.cli import main

main()
