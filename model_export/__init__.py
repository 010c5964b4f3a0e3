"""From a fitted model to a signed, fixed-point model image."""
