"""Random mechanical parts to train on. Importing this loads the CAD kernel, which takes seconds."""

from sed2cad.training.synthetic.folder import SyntheticReport, write_parts
from sed2cad.training.synthetic.part import random_part

__all__ = ["SyntheticReport", "random_part", "write_parts"]
