"""The arm at work: drives and motions, transient vibration, resonance, spectra. Knows no measurements."""
