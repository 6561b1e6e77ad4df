"""SED-Net and the pair-affinity network: points in, type, edge probability and descriptor out."""
