"""What the Rust core offers to the package; `geoerr.*` is the public face."""

__version__: str
