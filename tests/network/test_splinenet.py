"""SplineNet: its splines, its weights on disk, and what the shipped one is worth as a start."""

import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from sed2cad.errors import WeightsError
from sed2cad.network.architecture import SplineShape
from sed2cad.network.predict_net import control_net, predicted_net, predicted_starts
from sed2cad.network.spline_frame import CONTROLS, patch_frame, spline_basis, spline_knots
from sed2cad.network.splinenet import SplineNet
from sed2cad.network.stored import SHIPPED, SHIPPED_SPLINENET
from sed2cad.network.weights import layers_of, load_splinenet, save_splinenet
from sed2cad.primitives.net_fit import fit_net
from tests.primitives.sheets import hose
from tests.primitives.test_bspline import wave

SMALL = SplineShape(8, 8, 8)


def tube(count, seed=0):
    """About half of the hose, 0.4 long."""
    points, normals = hose(3 * count, seed)
    some = np.flatnonzero(points[:, 0] < 0.4)[:count]
    return points[some], normals[some]


@pytest.mark.parametrize("closed", [False, True])
def test_the_basis_is_that_of_the_knots(closed):
    at, net = np.linspace(0, 1, 30), np.random.default_rng(0).normal(size=(CONTROLS, 3))
    basis = spline_basis(at, closed)
    assert basis.sum(1) == pytest.approx(1, abs=1e-6)
    repeated = np.concatenate([net, net[:3]]) if closed else net
    assert basis @ net == pytest.approx(BSpline(spline_knots(closed), repeated, 3)(at), abs=1e-5)
    if closed:
        assert basis[0] == pytest.approx(basis[-1], abs=1e-6)


def test_the_frame_of_a_patch():
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3)) * [3.0, 0.1, 1.0] + 5
    centre, axes, half = patch_frame(points)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12) and np.linalg.det(axes) == pytest.approx(1)
    assert np.abs(axes[0] @ [1, 0, 0]) > 0.99 and np.abs(axes[2] @ [0, 1, 0]) > 0.99
    assert np.abs((points - centre) @ axes.T).max() == pytest.approx(half)


def test_round_trip_and_damage(tmp_path):
    network, path = SplineNet(SMALL), tmp_path / "w.safetensors"
    save_splinenet(network, path)
    loaded = load_splinenet(path)
    assert loaded.shape == SMALL and not loaded.training
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[name], tensor)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    with pytest.raises(WeightsError):
        load_splinenet(path)
    with pytest.raises(WeightsError, match="another network"):
        load_splinenet(SHIPPED)


def test_an_untrained_network_predicts_a_plane_and_a_tube():
    network = SplineNet(SMALL)
    for head in network.heads:
        torch.nn.init.zeros_(head[-1].weight)
    points, normals = wave(300)
    sheet = predicted_net(points, normals, False, layers_of(network))
    assert np.ptp((sheet.net.reshape(-1, 3) - sheet.net.mean((0, 1))) @ np.linalg.svd(points)[2][2]) < 0.1
    tube = predicted_net(points, normals, True, layers_of(network))
    ends = tube.at(np.array([[0.0, 0.5], [1.0, 0.5]]))
    assert tube.closed and ends[0] == pytest.approx(ends[1], abs=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_at_work_it_is_the_network_that_was_trained(closed):
    torch.manual_seed(0)
    network, points = SplineNet(SMALL), torch.randn(40, 6)
    with torch.no_grad():
        expected = network(points[None], closed)[0].numpy()
    np.testing.assert_allclose(control_net(layers_of(network), points.numpy(), closed), expected, atol=1e-5)


@pytest.mark.skipif(not SHIPPED_SPLINENET.exists(), reason="no weights in this tree")
@pytest.mark.parametrize(("sheet", "closed"), [(wave, False), (tube, True)])
def test_the_shipped_one_is_a_start(sheet, closed):
    points, normals = sheet(1500)
    start = next(start for start in predicted_starts(points, normals) if (start.period > 0) == closed)
    found = fit_net(points, start, 0.0)
    assert found is not None and found.surface.closed == closed
    assert np.sqrt(np.mean(found.surface.distance(sheet(400, 1)[0]) ** 2)) < 1e-3
    assert SHIPPED_SPLINENET.stat().st_size < 3e6
