"""What has to be given before a model can be looked at, fitted and searched: one answer for every panel."""

from __future__ import annotations

from geoerr.workbench.session import Session

_MACHINE = "a machine (machine.toml) or a model (model.json)"
_MEASUREMENTS = "measured points or circular tests (.csv, .parquet)"


def wanting(session: Session) -> str:
    """Say what is wanting, in a sentence; empty where nothing is."""
    measured = session.measured
    if measured is not None and measured.has_lengths_only:
        return (
            "Measured lengths say how far a model is off over them, not where. This page looks at places: add "
            f"{_MEASUREMENTS}; geoerr fit and geoerr diagnose take lengths alone."
        )
    missing = [] if session.steps else [_MACHINE]
    missing += [] if measured is not None else [_MEASUREMENTS]
    return f"Add {', and '.join(missing)}." if missing else ""
