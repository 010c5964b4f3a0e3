"""Benchmarks: speed and memory, side by side with what people would pick instead; `make bench` runs them."""
