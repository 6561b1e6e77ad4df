"""From the network's labels to patches: points of one surface."""
