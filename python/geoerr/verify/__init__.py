"""Proof: circular test, workpiece, path."""
