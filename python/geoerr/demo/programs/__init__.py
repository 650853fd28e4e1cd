"""Example programs, written for geoerr by `make.py` beside them."""
