"""Drives and motion at work: transient, spectrum, resonance, sweep, design."""
