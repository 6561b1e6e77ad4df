"""What is written beside the STEP file: model JSON, script, pictures."""
