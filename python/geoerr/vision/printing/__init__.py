"""Plates and boards to print: PDF pages true to scale, each with rulers to check the print by."""
