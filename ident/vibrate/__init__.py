"""The arm at work: prescribed motions of the pins and the vibration that follows."""
