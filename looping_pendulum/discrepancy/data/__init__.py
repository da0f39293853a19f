"""What was measured: study files, readers of every kind of table, and what the camera did."""
