"""The workbench: a local page on which a model is compared, its gaps are named, and the error is seen falling."""
