"""The virtual machine and its cameras."""
