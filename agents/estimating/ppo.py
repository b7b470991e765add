"""PPO in one file over native vector environments: an agent that tracks by itself.

`python agents/estimating/ppo.py` trains, and shows the mean error on episodes that training does not meet,
beside PDA's on the same ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time

import numpy as np
import torch
import typer
from quiet import errors, tracker_errors, vector
from torch import nn


@dataclass
class Settings:
    """All there is to choose."""

    seed: int = 0
    steps: int = 1_500_000  # of all environments together
    envs: int = 64
    rollout: int = 64  # steps of each environment between updates
    epochs: int = 4
    batches: int = 8
    learning_rate: float = 1e-3  # at first; it falls to nothing
    gamma: float = 0.9
    gae_lambda: float = 0.9
    clip: float = 0.2
    width: int = 64
    log_deviation: float = -2.5  # of actions, at first
    value_weight: float = 0.5
    gradient_norm: float = 0.5


class Agent(nn.Module):
    """A network that acts, and one that values."""

    def __init__(self, inputs: int, actions: int, settings: Settings):
        super().__init__()
        self.actor, self.critic = (network(inputs, settings.width, out) for out in (actions, 1))
        self.log_deviation = nn.Parameter(torch.full((actions,), settings.log_deviation))

    def forward(self, seen):
        """The distribution of actions, and the value."""
        return torch.distributions.Normal(self.actor(seen), self.log_deviation.exp()), self.critic(seen)[:, 0]

    @torch.no_grad()
    def act(self, observation) -> np.ndarray:
        """The actions of an agent that does not explore."""
        return self.actor(flat(observation)).clamp(-1, 1).numpy()


def network(inputs: int, width: int, outputs: int) -> nn.Module:
    """Two hidden layers, and outputs near zero at first."""
    last = nn.Linear(width, outputs)
    nn.init.orthogonal_(last.weight, 0.01)
    return nn.Sequential(nn.Linear(inputs, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(), last)


def flat(observation) -> torch.Tensor:
    """Detections and mask in a row."""
    detections, mask = observation["detections"], observation["mask"].astype(np.float32)
    return torch.tensor(np.hstack([detections.reshape(len(mask), -1), mask]))


def train(settings: Settings, **world) -> Iterator[tuple[int, Agent]]:
    """The steps taken so far and the agent, at first and after every update."""
    torch.manual_seed(settings.seed)
    n, T, envs = settings.envs, settings.rollout, vector(settings.envs, **world)
    now = flat(envs.reset(seed=settings.seed)[0])
    inputs, (actions,) = now.shape[1], envs.single_action_space.shape
    agent = Agent(inputs, actions, settings)
    optimizer = torch.optim.Adam(agent.parameters(), settings.learning_rate, eps=1e-5)
    seen, taken = torch.empty(T, n, inputs), torch.empty(T, n, actions)
    rewards, going, values, logs = torch.empty(4, T, n)
    updates = max(settings.steps // (n * T), 1)
    yield 0, agent
    for update in range(updates):
        optimizer.param_groups[0]["lr"] = settings.learning_rate * (1 - update / updates)
        with torch.no_grad():
            for t in range(T):
                said, values[t] = agent(now)
                seen[t], taken[t] = now, said.sample()
                logs[t] = said.log_prob(taken[t]).sum(1)
                observation, reward, *ended, _ = envs.step(taken[t].clamp(-1, 1).numpy())
                now, rewards[t] = flat(observation), torch.tensor(reward)
                going[t] = torch.tensor(~(ended[0] | ended[1]))
            value, gain, advantages = agent(now)[1], torch.zeros(n), torch.empty(T, n)
            for t in reversed(range(T)):
                error = rewards[t] + settings.gamma * going[t] * value - values[t]
                advantages[t] = gain = error + settings.gamma * settings.gae_lambda * going[t] * gain
                value = values[t]
        data = seen, taken, logs, advantages, advantages + values
        learn(agent, optimizer, settings, [part.flatten(0, 1) for part in data])
        yield (update + 1) * n * T, agent


def learn(agent: Agent, optimizer, settings: Settings, data: list[torch.Tensor]) -> None:
    """Several epochs of clipped updates."""
    for _ in range(settings.epochs):
        for rows in torch.randperm(len(data[0])).chunk(settings.batches):
            seen, taken, logs, advantages, returns = (part[rows] for part in data)
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
            said, values = agent(seen)
            ratio = (said.log_prob(taken).sum(1) - logs).exp()
            clipped = ratio.clamp(1 - settings.clip, 1 + settings.clip)
            loss = -torch.min(ratio * advantages, clipped * advantages).mean()
            loss = loss + settings.value_weight * (values - returns).square().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), settings.gradient_norm)
            optimizer.step()


def main(seed: int = Settings.seed, steps: int = Settings.steps, episodes: int = 100) -> None:
    """Train, and compare with PDA."""
    torch.set_num_threads(1)  # small networks run no faster on more
    seeds = range(1_000_000, 1_000_000 + episodes)
    print(f"pda: {tracker_errors('pda', seeds).mean():.2f} m")
    settings = Settings(seed, steps)
    for taken, agent in train(settings):
        if taken // (settings.envs * settings.rollout) % 50 == 0 or taken + settings.envs > steps:
            print(
                f"{taken} steps, {process_time():.0f} s: {errors(agent.act, seeds).mean():.2f} m", flush=True
            )


if __name__ == "__main__":
    typer.run(main)
