"""Linear solvers for Newton's tangent: Cholesky on the strip, and general sparse ones."""
