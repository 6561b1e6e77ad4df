"""Completing what the scan does not show."""
