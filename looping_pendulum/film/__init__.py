"""Track a film: from the pictures of a camera that stands still to a table of points of both masses.

`decode` reads pictures and their times, `moving` finds what moves before a still background, `pendulum` tells the masses from
all else by the string that ties them, `track` is the function to call, and `output` writes what was found.
"""
