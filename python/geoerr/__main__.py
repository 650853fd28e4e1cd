"""`python -m geoerr`: the command line where its script is not on the path."""

from geoerr.cli.main import run

if __name__ == "__main__":
    run()
