"""Benchmarks: what `make bench` prints. Never run as tests."""
