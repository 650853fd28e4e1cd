"""Programs rewritten for the machine they run on."""
