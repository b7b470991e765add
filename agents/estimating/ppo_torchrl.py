"""PPO of TorchRL's parts, over native vector environments: `python agents/estimating/ppo_torchrl.py`.

TorchRL begins episodes anew by itself: `GymWrapper` is given environments whose autoreset mode is "Disabled".
"""

import numpy as np
import torch
import typer
from quiet import errors, tracker_errors, vector
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

SEEN = ["detections", "mask"]


class Flat(nn.Module):
    """A network of detections and mask in a row."""

    def __init__(self, inputs: int, outputs: int, *last: nn.Module, width: int = 64):
        super().__init__()
        hidden = nn.Linear(inputs, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh()
        self.layers = nn.Sequential(*hidden, nn.Linear(width, outputs), *last)

    def forward(self, detections, mask):
        """Outputs (..., outputs), or what the last layers make of them."""
        return self.layers(torch.cat([detections.flatten(-2), mask.to(detections.dtype)], dim=-1))


def networks(env: GymWrapper) -> tuple[ProbabilisticActor, ValueOperator]:
    """An actor, near zero and sure at first, and a critic."""
    rows, p = env.observation_spec["detections"].shape[-2:]
    actor = Flat(rows * (p + 1), 2 * p, NormalParamExtractor("biased_softplus_0.08"))
    nn.init.orthogonal_(actor.layers[-2].weight, 0.01)
    return (
        ProbabilisticActor(
            TensorDictModule(actor, in_keys=SEEN, out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            spec=env.action_spec_unbatched,
            distribution_class=TanhNormal,
            return_log_prob=True,
        ),
        ValueOperator(Flat(rows * (p + 1), 1), in_keys=SEEN),
    )


def train(steps: int, envs: int = 64, frames: int = 4096, seed: int = 0, **world) -> ProbabilisticActor:
    """The actor after so many steps of all environments together."""
    torch.manual_seed(seed)
    env = GymWrapper(vector(envs, "Disabled", **world))
    env.set_seed(seed)
    actor, critic = networks(env)
    frames = min(frames, steps)
    collector = Collector(
        env, actor, frames_per_batch=frames, total_frames=steps, auto_register_policy_transforms=False
    )
    advantage = GAE(gamma=0.9, lmbda=0.9, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, entropy_bonus=False, critic_coeff=0.5)
    optimizer = torch.optim.Adam(loss.parameters(), 1e-3)
    for data in collector:
        for _ in range(4):
            advantage(data)
            flat = data.reshape(-1)
            for rows in torch.randperm(len(flat)).chunk(8):
                found = loss(flat[rows])
                optimizer.zero_grad()
                (found["loss_objective"] + found["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
    collector.shutdown()
    return actor


def acting(actor: ProbabilisticActor):
    """The actions of an actor that does not explore."""

    @torch.no_grad()
    def act(observation: dict[str, np.ndarray]) -> np.ndarray:
        seen = TensorDict({key: torch.tensor(observation[key]) for key in SEEN}, len(observation["mask"]))
        return actor.get_dist(seen).deterministic_sample.clamp(-1, 1).numpy()

    return act


def main(steps: int = 1_000_000, episodes: int = 100) -> None:
    """Train, and compare with PDA."""
    torch.set_num_threads(1)  # small networks run no faster on more
    seeds = range(1_000_000, 1_000_000 + episodes)
    print(f"pda: {tracker_errors('pda', seeds).mean():.2f} m")
    print(f"agent: {errors(acting(train(steps)), seeds).mean():.2f} m")


if __name__ == "__main__":
    typer.run(main)
