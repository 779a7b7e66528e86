"""From measurements to parameters: predict, fit, and what the data can tell."""
