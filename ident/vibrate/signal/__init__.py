"""Traces: spectra, spectrograms, orders, comparison."""
