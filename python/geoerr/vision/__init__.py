"""Pictures to points: calibration, detection, sessions to observations."""
