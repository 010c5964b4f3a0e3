"""What the probe runs; the host imports the same files."""
