"""The simulated world: the tissue under a stroke (`sim.tissue`) and the probe that feels it (`sim.probe`)."""
