"""The simulated world: the tissue under a stroke (`tissue`) and the probe that feels it (`probe`)."""
