"""Training data from CAD files, the losses of the paper, and the training loop."""
