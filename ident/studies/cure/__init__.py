"""Cures of a vibration: another motion, balanced drives, other parameters; from a campaign to advice."""
