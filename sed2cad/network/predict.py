"""The network as a function: points and normals in, labels of every point out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sed2cad.network.affinity import PAIR_NEIGHBOURS, same_patch
from sed2cad.network.batch import Cloud, stack
from sed2cad.network.features import local_features
from sed2cad.network.graph import MAX_POINTS, neighbour_graph
from sed2cad.network.sednet import SedNet
from sed2cad.network.types import from_paper

NORMAL_WEIGHT = 0.03
"""A point takes the labels of the network's point next to it in (x, 0.03 n): on its side of a thin wall."""


@dataclass(frozen=True)
class PointLabels:
    """What the network says about each of n points."""

    types: NDArray[np.float32]  # (n, 6) probabilities, in the order of PATCH_TYPES
    edge: NDArray[np.float32]  # (n,) probability to lie near an edge
    descriptors: NDArray[np.float32]  # (n, d), alike on one patch
    neighbours: NDArray[np.int64]  # (n, 10) nearest other points (of those the network sees)
    same: NDArray[np.float32]  # (n, 10) probability to lie on one patch with that neighbour; 0.5 without pair network


def predict(points: NDArray, normals: NDArray, network: SedNet, seed: int = 0, device: str = "cpu") -> PointLabels:
    """Label points (n, 3), n >= 50, in any frame and unit, with unit normals (n, 3).

    The network sees at most 10,000 of them in the frame it was trained in (box centred, longest side 1); the
    others take the labels of their nearest neighbour among those. The same seed gives the same labels.
    """
    order = np.random.default_rng(seed).permutation(len(points))
    points, normals = to_unit_frame(points)[order], np.asarray(normals, np.float32)[order]
    graph = neighbour_graph(points)
    seen = slice(MAX_POINTS)
    batch = stack([Cloud(points[seen], normals[seen], graph[:, seen])]).to(device)
    with torch.no_grad():
        output = [part.cpu() for part in network.to(device).eval()(batch)]
    keys = np.hstack([points, NORMAL_WEIGHT * normals])
    nearest = cKDTree(keys[seen]).query(keys)[1]
    near, same = _pairs(points, normals, graph, network.to("cpu"))
    back = np.argsort(order)
    probabilities = output[0].softmax(1).numpy()
    types, edge, descriptors = (
        probabilities if network.shape.torus else from_paper(probabilities),
        output[1].softmax(1)[:, 1].numpy(),
        output[2].numpy(),
    )
    row = nearest[back]
    return PointLabels(types[row], edge[row], descriptors[row], order[near][back], same[back])


def _pairs(points: NDArray, normals: NDArray, graph: NDArray, network: SedNet) -> tuple[NDArray, NDArray]:
    """Nearest others of each point among those the network sees, and the probability to share a patch."""
    near = graph[0].astype(np.int64)
    near = np.vstack([near[:MAX_POINTS, 1 : PAIR_NEIGHBOURS + 1], near[MAX_POINTS:, :PAIR_NEIGHBOURS]])
    if network.affinity is None:
        return near, np.full(near.shape, 0.5, np.float32)
    neighbours = torch.from_numpy(graph.astype(np.int64))
    features = local_features(torch.from_numpy(points), torch.from_numpy(normals), neighbours)
    return near, same_patch(network.affinity, features, torch.from_numpy(near)).numpy()


def to_unit_frame(points: NDArray) -> NDArray[np.float32]:
    """Points moved and scaled so that their box is centred and its longest side is 1."""
    points = np.asarray(points, np.float64)
    low, high = points.min(0), points.max(0)
    return ((points - (low + high) / 2) / max((high - low).max(), 1e-300)).astype(np.float32)
