"""Plates and boards to print: PDF pages true to scale, each with a ruler to check the print by."""
