"""The arm at work: how it vibrates along a motion, and where drives excite its modes."""
