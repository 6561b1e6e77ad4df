"""The shapes of the networks: what their weights belong to, stored with them."""

from __future__ import annotations

from dataclasses import dataclass

FUSION = 0.2
"""Weight of either fusion (the paper, section 3.2)."""
GLOBAL_POINTS = 1_024
"""The global feature is the maximum over this many points."""
SLOPE = 0.2
"""Of LeakyReLU below 0."""


@dataclass(frozen=True)
class Architecture:
    """Of SED-Net."""

    widths: tuple[int, int, int] = (64, 64, 128)
    global_width: int = 1_024
    point_width: int = 512
    branch_width: int = 256
    descriptor: int = 128
    local_width: int = 128  # of the point-wise network on local features; 0: plain points and normals, as the paper
    transformer_layers: int = 2  # on the coarse points; 0: none, as the paper
    transformer_width: int = 192
    transformer_heads: int = 6
    early_fusion: bool = True
    late_fusion: bool = True
    affinity_width: int = 0  # of the pair network, which is trained apart and attached; 0: none
    two_branches: bool = True  # False: one branch gives type, edge and descriptor, and nothing is fused
    torus: bool = True  # classes are PATCH_TYPES; False: PAPER_TYPES
    dynamic: int = 0  # neighbours in graphs rebuilt before each EdgeConv, as the paper (64); 0: fixed graphs


@dataclass(frozen=True)
class SplineShape:
    """Widths of SplineNet."""

    point: int = 128
    patch: int = 256
    head: int = 320
