"""Printed reports, one file a capability."""
