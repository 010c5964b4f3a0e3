"""Signing keys and signatures (SLH-DSA, FIPS 205)."""
