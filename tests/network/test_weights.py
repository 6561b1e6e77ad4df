import pytest
import torch
from safetensors.torch import save_file

from sed2cad.errors import WeightsError
from sed2cad.network.affinity import PairNet
from sed2cad.network.architecture import Architecture
from sed2cad.network.labeller import Labeller
from sed2cad.network.sednet import SedNet
from sed2cad.network.stored import SHIPPED
from sed2cad.network.weights import load_weights, save_weights

SMALL = Architecture((8, 8, 8), 16, 16, 8, 4, 8, 1, 8, 2)


def test_round_trip(tmp_path):
    network = SedNet(SMALL)
    network.attach(PairNet(8), 8)
    save_weights(network, tmp_path / "w.safetensors")
    loaded = load_weights(tmp_path / "w.safetensors")
    assert loaded.shape == network.shape
    assert not loaded.training
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[name], tensor)


def test_half_precision_is_smaller_and_close(tmp_path):
    network = SedNet(SMALL)
    save_weights(network, tmp_path / "a")
    save_weights(network, tmp_path / "b", half=True)
    assert (tmp_path / "b").stat().st_size < 0.75 * (tmp_path / "a").stat().st_size
    torch.testing.assert_close(
        load_weights(tmp_path / "b").type_head.weight, network.type_head.weight, atol=1e-3, rtol=1e-3
    )


def damaged(path):
    save_weights(SedNet(SMALL), path)
    path.write_bytes(path.read_bytes()[:-200])


def text(path):
    path.write_text("not weights")


def other_network(path):
    save_file({"a": torch.zeros(3)}, path)


def other_shape(path):
    network = SedNet(SMALL)
    network.shape = Architecture()
    save_weights(network, path)


def not_finite(path):
    network = SedNet(SMALL)
    with torch.no_grad():
        network.type_head.bias.fill_(float("nan"))
    save_weights(network, path)


def missing(path):
    pass


@pytest.mark.parametrize("spoil", [damaged, text, other_network, other_shape, not_finite, missing])
@pytest.mark.parametrize("load", [load_weights, Labeller.load])
def test_bad_file_is_refused_in_one_sentence(tmp_path, spoil, load):
    path = tmp_path / "w.safetensors"
    spoil(path)
    with pytest.raises(WeightsError) as error:
        load(path)
    message = str(error.value)
    assert str(path) in message
    assert message.endswith(".")
    assert "\n" not in message


@pytest.mark.skipif(not SHIPPED.exists(), reason="no weights in this tree")
def test_shipped_weights_load():
    network = load_weights()
    assert network.affinity is not None
    assert SHIPPED.stat().st_size < 10e6
