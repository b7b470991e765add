"""From a trained model to a file of plain arrays, which baselines/learned.py reads without torch:
`python agents/export.py RUN --chapter N policy.npz`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from critics import Seen
from judge import played
from learner import environments, recorded, restored

from gmr_gym.experiments.output import write_rows
from gmr_gym.tuning.network import Network, save
from gmr_gym.tuning.policies import ByNetwork

PRICES = tuple(10.0**k for k in np.linspace(-5, -1.5, 8))
ACTIVATIONS = {torch.nn.Tanh: "tanh", torch.nn.ReLU: "relu"}


def network_of(model, venv) -> Network:
    """The deterministic policy of a model whose layers have one activation between them, with the moments by
    which `venv` normalises what it sees. Raises ValueError for a policy of another kind."""
    policy = model.policy
    if hasattr(policy, "lstm_actor"):
        raise ValueError("a policy that remembers is no stack of layers, and cannot be exported")
    squashed = hasattr(policy, "actor")  # off policy: the action is tanh of the mean
    if squashed:
        layers = [*policy.actor.latent_pi, policy.actor.mu]
    else:
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    layers = [layer for layer in layers if not isinstance(layer, Seen)]
    linear, between = layers[::2], layers[1::2]
    kinds = {ACTIVATIONS.get(type(layer)) for layer in between}
    features = venv.get_attr("features")[0]
    sound = all(isinstance(layer, torch.nn.Linear) for layer in linear) and len(kinds - {None}) < 2
    if not sound or None in kinds or linear[0].in_features != len(features):
        raise ValueError(f"a policy must lead from features by linear layers with tanh or ReLU, got {layers}")
    return Network(
        features,
        venv.get_attr("parameters")[0],
        *normalisation(venv),
        kinds.pop() if kinds else "tanh",
        squashed,
        tuple(layer.weight.detach().double().numpy() for layer in linear),
        tuple(layer.bias.detach().double().numpy() for layer in linear),
    )


def normalisation(venv) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean (k,) and deviation (k,) of the features by which `venv` normalises them, and how many deviations
    it lets through."""
    k = len(venv.get_attr("features")[0])
    deviation = np.sqrt(venv.obs_rms.var[:k] + venv.epsilon)
    return np.array(venv.obs_rms.mean[:k], float), deviation, float(venv.clip_obs)


def works(network: Network, env: Mapping[str, Any], runs: int) -> list[tuple[float, float]]:
    """Prices of work, and the mean work of a scan at each, on VALID, in the environment that it was trained
    in."""
    same = {name: value for name, value in env.items() if name != "instances"}
    found = (
        played({"": ByNetwork(network)}, "wide-valid", runs, env={**same, "price": price}, jobs=1)[""]
        for price in PRICES
    )
    return [(price, float(one.work.mean())) for price, one in zip(PRICES, found, strict=True)]


def main(
    run: Annotated[Path, typer.Argument(help="folder of a run")],
    out: Annotated[Path, typer.Argument(help="the .npz to write")],
    chapter: Annotated[int | None, typer.Option(help="the last unless given")] = None,
    runs: Annotated[
        int, typer.Option(help="episodes of every instance of VALID, for the work at each price", min=1)
    ] = 40,
) -> None:
    """Write the policy after a chapter of a run, and beside it how much work it does at which price."""
    settings, last = recorded(run)
    venv = environments(settings)
    network = network_of(restored(run, last if chapter is None else chapter, settings, venv), venv)
    save(out, network)
    write_rows(out.with_suffix(".csv"), ("price", "work"), works(network, settings.env, runs))
    print(f"written to {out}")


if __name__ == "__main__":
    typer.run(main)
