"""Labels of a CAD system's mesh against the surfaces that its vertices lie on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sed2cad.fitting import fit_patches
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.segmentation.segment import segment
from sed2cad.topology.labelling import adjacency, data_costs, label_triangles
from sed2cad.topology.proxy import proxy_mesh
from tests.segmentation.shapes import bar


def test_triangles_go_to_the_surface_that_their_vertices_lie_on() -> None:
    """Narrow planes that two cylinders are tangent to, a tenth of the tolerance off these."""
    mesh = bar()
    found = segment(prepare(RawScan(mesh.vertices, None, mesh), 0), None)
    scan, fitted = found.scan, fit_patches(found.scan, found.patches)
    points = np.full(len(scan.points), -1)
    for k, patch in enumerate(fitted):
        points[patch.patch.indices] = k
    proxy = proxy_mesh(scan)
    flat = [k for k, f in enumerate(fitted) if f.primitive.kind == "plane" and len(f.patch.indices) < 1000]
    assert len(flat) == 2
    round_ones = [k for k, f in enumerate(fitted) if f.primitive.kind == "cylinder"]
    blind = replace(scan, triangle=None)
    exact, blunt = (data_costs(proxy, seen, fitted, points) for seen in (scan, blind))
    labels = label_triangles(proxy, adjacency(proxy), exact)
    for plane in flat:
        off = np.abs(fitted[plane].primitive.distance(proxy.vertices))[proxy.faces].max(axis=1)
        on = np.flatnonzero((off < 1e-7) & np.isfinite(blunt[:, plane]))
        assert len(on) and np.all(labels[on] == plane)
        least = [costs[on][:, round_ones].min(axis=1) - costs[on, plane] for costs in (blunt, exact)]
        assert least[0].min() < 0 < least[1].min()  # beside the border, where neighbours vote for the cylinder
