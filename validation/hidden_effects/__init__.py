"""Data sets for the study of hidden effects: virtual machines that were measured while something was wrong.

Nothing here knows how the package explains data: no kinematics, catalogue, expression or fit of it is used. Machines
and tables (`geoerr.machine`, `geoerr.observations`) are all that the two sides share. See README.md.
"""
