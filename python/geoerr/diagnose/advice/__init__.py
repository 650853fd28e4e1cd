"""The next measurement: what would tell apart candidates that the data cannot."""
