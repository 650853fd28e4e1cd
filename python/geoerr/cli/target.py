"""`geoerr target`: plates and boards to print, true to scale."""
