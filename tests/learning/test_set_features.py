"""Features of sets: whatever the order of detections, and whatever stands where there is none."""

import subprocess
import sys

import numpy as np
import pytest
from gymnasium import spaces

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from gmr_gym.learning.set_features import POOLS, SetFeatures  # noqa: E402

SPACE = spaces.Dict({
    "detections": spaces.Box(-1, 1, (6, 2), np.float32),
    "mask": spaces.Box(0, 1, (6,), np.int8),
    "truth": spaces.Box(-1, 1, (2,), np.float32),
})  # fmt: skip


def network(pool):
    torch.manual_seed(0)
    return SetFeatures(SPACE, pool, width=8)


def batch():
    """Five scans of 0 to 6 detections."""
    rng = np.random.default_rng(0)
    mask = (np.arange(6) < np.array([0, 1, 3, 5, 6])[:, None]).astype(np.float32)
    detections = rng.uniform(-1, 1, (5, 6, 2)).astype(np.float32) * mask[:, :, None]
    parts = {"detections": detections, "mask": mask, "truth": rng.uniform(-1, 1, (5, 2)).astype(np.float32)}
    return {key: torch.tensor(part) for key, part in parts.items()}


@pytest.mark.parametrize("pool", POOLS)
def test_features_do_not_depend_on_the_order_of_detections(pool):
    net, seen = network(pool), batch()
    order = torch.tensor(np.random.default_rng(1).permutation(6))
    turned = seen | {"detections": seen["detections"][:, order], "mask": seen["mask"][:, order]}
    assert torch.allclose(net(seen), net(turned), atol=1e-6)  # sums in another order


@pytest.mark.parametrize("pool", POOLS)
@pytest.mark.parametrize("padding", [0.7, 1e30, float("nan"), float("inf")])
def test_features_and_their_gradients_do_not_depend_on_what_masked_rows_contain(pool, padding):
    net, seen = network(pool), batch()
    absent = seen["mask"][:, :, None] == 0
    padded = seen | {"detections": torch.where(absent, padding, seen["detections"])}
    found = []
    for each in (seen, padded):
        net.zero_grad()
        out = net(each)
        out.square().sum().backward()
        found.append([out, *(part.grad for part in net.parameters())])
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other) and torch.isfinite(one).all()


@pytest.mark.parametrize("pool", POOLS)
def test_features_depend_on_every_detection_there_is_and_are_nothing_without(pool):
    net, seen = network(pool), batch()
    out = net(seen)
    assert out.shape == (5, net.features_dim) == (5, 10)
    assert not out[0, :8].any()
    assert torch.equal(out[:, 8:], seen["truth"])
    for row in range(3):
        less = seen | {"mask": seen["mask"].clone()}
        less["mask"][2, row] = 0
        assert not torch.allclose(net(less)[2], out[2])


def test_the_pools_are_what_they_are_called():
    seen, one = batch(), [0.25, -0.5]
    seen["detections"][:] = torch.tensor(one)
    alone = {key: part[1:2] for key, part in seen.items()}
    for pool in POOLS:  # of equal detections that of one, however many
        net = network(pool)
        assert torch.allclose(net(seen)[1:, :8], net(alone)[:, :8], atol=1e-6)
    net = network("mean")
    h = torch.stack([net(batch() | {"mask": torch.eye(6)[[i] * 5]})[3, :8] for i in range(5)])
    for pool, found in (("mean", h.mean(dim=0)), ("maximum", h.amax(dim=0))):
        assert torch.allclose(network(pool)(batch())[3, :8], found, atol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"pool": "sum"}, "^pool must be one of mean, maximum, attention, got 'sum'$"),
        ({"width": 0}, "^width must be at least 1"),
        ({"detections": "scan"}, "^observation_space must be a Dict with 'scan' and 'mask', got Dict"),
        ({"observation_space": spaces.Box(-1, 1)}, "must be a Dict with 'detections' and 'mask', got Box"),
    ],
)
def test_wrong_arguments_are_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        SetFeatures(**{"observation_space": SPACE} | wrong)


def test_the_room_imports_no_torch_and_without_it_the_features_say_what_installs_it():
    code = (
        "import sys, gmr_gym.learning\n"
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)\n"
        "sys.modules['torch'] = None\n"
        "import gmr_gym.learning.set_features\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert "needs the extra `agents`: pip install 'gmr-gym[agents]'" in done.stderr.splitlines()[-1]
