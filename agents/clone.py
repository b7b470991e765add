"""A policy cloned from a data set of `gmr-gym episodes`, in the format of the shipped ones:
`python agents/clone.py DATASET clone.npz`. It is judged beside the one it was cloned from, on episodes of
instances that neither the data set nor the training has."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from judge import Episodes, played
from report import table_of
from scores import against, figures, together

from gmr_gym.experiments.screen import progress
from gmr_gym.offline import load, players_of
from gmr_gym.tuning.network import Network, save
from gmr_gym.tuning.policies import ByNetwork

BATCH, RATE, REACH = 256, 2e-3, 10.0  # pairs, of Adam, standard deviations that normalised features keep
SHOWN = {"reward": ("reward", 1), "track_loss": ("targets lost, %", 100), "work": ("work a scan", 1)}


def pairs(dataset: Any, player: str) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, k) and actions (n, j) of every step of a player. ValueError where it played none."""
    known = dataset.storage.metadata["gmr_gym"]["players"]
    if player not in known:
        raise ValueError(f"{player!r} is not among the players of {dataset.id}: {', '.join(known)}")
    place = known.index(player)
    mine = [episode for episode in dataset if episode.infos["player"][0] == place]
    features = np.concatenate([episode.observations[:-1] for episode in mine])
    return features, np.concatenate([episode.actions for episode in mine])


def cloned(
    env: Any, features: np.ndarray, actions: np.ndarray, units: int, epochs: int, seed: int
) -> tuple[Network, float]:
    """Two layers of tanh units that give the actions (n, j) for features (n, k), by least squares, and the
    root of the mean square that is left."""
    torch.manual_seed(seed)
    mean, deviation = features.mean(axis=0, dtype=float), features.std(axis=0, dtype=float) + 1e-4
    x = torch.as_tensor(((features - mean) / deviation).clip(-REACH, REACH), dtype=torch.float32)
    y = torch.as_tensor(actions, dtype=torch.float32)
    sizes = [x.shape[1], units, units, y.shape[1]]
    linear = [torch.nn.Linear(*pair) for pair in pairwise(sizes)]
    model = torch.nn.Sequential(linear[0], torch.nn.Tanh(), linear[1], torch.nn.Tanh(), linear[2])
    steps = epochs * -(-len(x) // BATCH)
    descent = torch.optim.Adam(model.parameters(), RATE)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(descent, steps)
    for _ in range(epochs):
        for rows in torch.randperm(len(x)).split(BATCH):
            descent.zero_grad()
            torch.nn.functional.mse_loss(model(x[rows]), y[rows]).backward()
            descent.step()
            slower.step()
    with torch.no_grad():
        left = float((model(x).clip(-1, 1) - y).square().mean().sqrt())
    weights, biases = zip(*((layer.weight, layer.bias) for layer in linear), strict=True)
    arrays = [tuple(part.detach().double().numpy() for part in parts) for parts in (weights, biases)]
    return Network(env.features, env.parameters, mean, deviation, REACH, "tanh", False, *arrays), left


def main(
    data: Annotated[Path, typer.Argument(help="folder of a data set of ReductionTuning")],
    out: Annotated[Path, typer.Argument(help="the .npz to write")],
    player: Annotated[str, typer.Option(help="which of its players is cloned")] = "learned",
    units: Annotated[int, typer.Option(help="of each of two layers", min=1)] = 64,
    epochs: Annotated[int, typer.Option(help="times that every step is seen", min=1)] = 100,
    seed: Annotated[int, typer.Option(help="of the training", min=0)] = 0,
    runs: Annotated[int, typer.Option(help="episodes of every instance held out", min=2)] = 40,
    table: Annotated[str, typer.Option(help="of instances held out; by default VALID")] = "",
) -> None:
    """Clone a policy, write it, and compare both on the same held-out episodes."""
    torch.set_num_threads(1)
    dataset = load(data)
    env = dataset.recover_environment(disable_env_checker=True).unwrapped
    settings = {
        "parameters": env.parameters, "reducer": env.reducer, "features": env.features, "price": env.price,
    }  # fmt: skip
    features, actions = pairs(dataset, player)
    network, left = cloned(env, features, actions, units, epochs, seed)
    save(out, network)
    print(f"{len(features)} steps cloned, {left:.3f} of an action's range of 2 is left; written to {out}")
    (original,) = players_of([player], env)
    policies = {player: original.begin(seed), "clone": ByNetwork(network)}
    held_out = table or ("wide-valid" if "wide" in str(env.spec.kwargs.get("instances")) else "valid")
    with progress("judged") as report:
        found = played(policies, held_out, runs, seed + 1, env=settings, jobs=1, progress=report)
    shown(*(together([episodes]) for episodes in found.values()), player)


def shown(theirs: Episodes, clone: Episodes, player: str) -> None:
    """Prints the figures of both, the difference, and whether the clone is within the interval."""
    rows = {player: figures(theirs), "clone": figures(clone)}
    print(table_of(SHOWN, rows))
    gain, reward, own = against(clone, theirs)["reward"], rows[player]["reward"], rows["clone"]["reward"]
    inside = "within" if reward.low <= own.value <= reward.high else "outside"
    print(f"clone minus {player}, the same episodes: {gain.value:.2f} ({gain.low:.2f} to {gain.high:.2f})")
    print(f"the clone's reward, {own.value:.2f}, is {inside} {reward.low:.2f} to {reward.high:.2f}")


if __name__ == "__main__":
    typer.run(main)
