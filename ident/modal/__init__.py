"""From force and response of a test to modes with their covariance; knows no arm."""
