"""Commands for teaching: a demonstration, a new scenario, an example folder, a file for Tracker."""
