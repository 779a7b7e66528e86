"""The arm at work: its vibration along a motion, and where drives excite its modes."""
