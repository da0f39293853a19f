"""Measured data: study files, readers of every kind of table, and the camera model."""
