"""The link to a probe: ports, messages, commands, flashing, events."""
