"""Reading scans and bringing them into the unit frame."""
