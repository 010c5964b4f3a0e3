"""From float64 coefficients to integers: quantised, proved to stay in range, measured."""
