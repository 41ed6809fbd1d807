"""Studies built on the rooms above: Chapter V, speed against error, calibration checks."""
