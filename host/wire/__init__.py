"""What the wire carries, as the host says it: cells, packing, calibration, packets, events, and losses."""
