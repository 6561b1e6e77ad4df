import torch

from sed2cad.network.edgeconv import EdgeConv, interpolate


def test_equals_the_textbook_form():
    """max_j (W1 x_i + W2 (x_j - x_i)), built edge by edge, with A = W1 - W2 and B = W2."""
    torch.manual_seed(0)
    layer = EdgeConv(5, 7)
    x, neighbours = torch.randn(40, 5), torch.randint(0, 40, (40, 6))
    w2 = layer.other.weight
    w1 = layer.own.weight + w2
    edges = x[:, None] @ w1.T + layer.own.bias + (x[neighbours] - x[:, None]) @ w2.T
    expected = torch.nn.functional.leaky_relu(layer.norm(edges.amax(1)), 0.2)
    torch.testing.assert_close(layer(x, x, neighbours), expected)


def test_gradient_reaches_the_neighbours():
    layer = EdgeConv(2, 3)
    table = torch.randn(4, 2, requires_grad=True)
    layer(torch.randn(1, 2), table, torch.tensor([[0, 1]]))[0, 0].backward()
    assert table.grad[2:].abs().sum() == 0
    assert table.grad[:2].abs().sum() > 0


def test_interpolation_is_a_weighted_sum():
    table = torch.tensor([[1.0, 0.0], [0.0, 2.0]])
    result = interpolate(table, torch.tensor([[0, 1]]), torch.tensor([[0.25, 0.75]]))
    torch.testing.assert_close(result, torch.tensor([[0.25, 1.5]]))
