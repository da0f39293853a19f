"""The command line, `looping-pendulum`: `main` has the commands, every other file one group of commands or one helper."""
