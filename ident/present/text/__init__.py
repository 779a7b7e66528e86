"""Printed reports; small ones share a file."""
