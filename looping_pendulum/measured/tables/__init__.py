"""Tables of any program into `Observations`."""
