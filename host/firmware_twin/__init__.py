"""The firmware's own source on the host, compiled: the same integers at the host's speed."""
