"""First look at a study, before any fit: do the tracked points move as was declared, but for what a fit is there to find?"""
