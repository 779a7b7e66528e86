"""The arm at work: motion, response, modes along the motion, signals, redesign. Knows no measurements."""
