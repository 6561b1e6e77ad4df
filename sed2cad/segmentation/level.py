"""Some points of a scan, as many as a refinement sees at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sed2cad.scan.scan import Scan
from sed2cad.segmentation.corners import Corners
from sed2cad.segmentation.energy import Tolerances
from sed2cad.segmentation.graph import Graph, neighbour_graph
from sed2cad.segmentation.refine import FEWEST, Refiner

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

FLOOR = 3e-4  # unit frame: facets and rounding leave deviations of this size on a clean scan


@dataclass(frozen=True)
class Level:
    """Some points of a scan, m of n, and their neighbours."""

    rows: NDArray[np.int64]  # (m,) ascending
    points: Array  # (m, 3)
    normals: Array  # (m, 3)
    graph: Graph
    part: Labels | None = None  # (m,) of the mesh, between sharp edges
    corners: Corners | None = None  # on a mesh of a CAD system
    fewest: int = FEWEST  # points that make a patch
    rim: float = 0.0  # spacings that the inner points of a patch keep off others, farther than their neighbours

    @classmethod
    def of(cls, scan: Scan, rows: NDArray[np.int64], tolerances: Tolerances) -> Level:
        """The given points of a scan."""
        points, normals = scan.points[rows], scan.normals[rows]
        spacing = scan.spacing * np.sqrt(len(scan.points) / len(rows))
        if scan.part is None or scan.noise > FLOOR:
            return cls(rows, points, normals, neighbour_graph(points, normals, spacing, tolerances.distance))
        graph = neighbour_graph(points, normals, spacing, tolerances.distance, scan.part[rows])
        corners = Corners.of(scan)
        return cls(rows, points, normals, graph, scan.part[rows], None if corners is None else corners[rows])

    def refiner(self, tolerances: Tolerances, freeform: Array | None) -> Refiner:
        """The refinement of these points; freeform (m,) as it wants it: anything that no surface goes through exactly
        may be freeform."""
        freeform = freeform if self.corners is None else np.ones(len(self.points))
        return Refiner(self.points, self.normals, self.graph, tolerances, freeform, self.corners, self.fewest)
