"""The command line, one verb a file.

A verb's file holds its options; what the verb works with is imported when it runs, and text that needs more than that
stands in a file of its own. So `--help` costs no numerical library, and every verb only what it needs.
"""
