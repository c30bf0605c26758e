"""Networks: sizes reach them, every input matters, chunks keep their shape."""

import pytest
import torch

from wrenchflow.errors import ConfigError
from wrenchflow.policy.config import DiffusionConfig, MlpConfig, PolicyConfig, UnetConfig
from wrenchflow.policy.networks import make_network

CONFIGS = {
    "mlp": PolicyConfig(network="mlp", mlp=MlpConfig(width=32, layers=2, step_embedding=8)),
    "unet": PolicyConfig(network="unet", unet=UnetConfig(widths=(16, 32, 48), step_embedding=8)),
    "unet of one level": PolicyConfig(network="unet", unet=UnetConfig(widths=(16,), step_embedding=8), horizon=7),
}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())
def test_output_has_the_shape_of_the_chunk_and_depends_on_every_input(config):
    torch.manual_seed(0)
    network = make_network(config, action_width=9, feature_width=5)
    chunk = torch.randn(3, config.horizon, 9, requires_grad=True)
    seen = torch.randn(3, config.n_obs_steps, 5, requires_grad=True)
    out = network(chunk, torch.tensor([0, 50, 99]), seen)
    assert out.shape == chunk.shape
    out.square().sum().backward()
    assert chunk.grad is not None
    assert seen.grad is not None
    assert (chunk.grad != 0.0).all()
    assert (seen.grad != 0.0).all()
    assert not torch.equal(out, network(chunk, torch.tensor([1, 51, 98]), seen))


def test_mlp_sizes_reach_the_network():
    network = make_network(CONFIGS["mlp"], action_width=9, feature_width=5)
    shapes = [tuple(p.shape) for p in network.parameters() if p.ndim == 2]
    assert shapes == [(32, 8 * 9 + 2 * 5 + 8), (32, 32), (8 * 9, 32)]


def test_unet_sizes_reach_the_network():
    network = make_network(CONFIGS["unet"], action_width=9, feature_width=5)
    convolutions = {tuple(p.shape) for p in network.parameters() if p.ndim == 3}
    assert {(16, 9, 5), (32, 16, 5), (48, 32, 5), (48, 48, 5), (32, 64, 5), (16, 32, 5)} <= convolutions


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PolicyConfig(horizon=2, n_action_steps=2), "expected at least 3"),
        (lambda: PolicyConfig(network="unet", horizon=9), "a multiple of 2"),
        (lambda: UnetConfig(widths=(12,)), "a multiple of 8"),
        (lambda: UnetConfig(kernel=4), "odd"),
        (lambda: MlpConfig(layers=0), "mlp.layers is 0"),
        (lambda: MlpConfig(step_embedding=9), "even"),
        (lambda: DiffusionConfig(steps=4), "at most diffusion.steps = 4"),
        (lambda: DiffusionConfig(eta=2.0), "from 0 to 1"),
    ],
)
def test_sizes_that_make_no_network_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
