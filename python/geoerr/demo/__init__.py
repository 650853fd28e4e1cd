"""The whole job on an example that geoerr brings along."""
