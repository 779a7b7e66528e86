"""Natural frequencies along a motion, and the frequencies that excite them."""
