"""What all environments share: drawing an episode, emitting it scan by scan, and rendering."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from inspect import signature
from numbers import Real
from types import NoneType, UnionType
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.points import check_unmasked
from gmr_gym.simulation.single_target import Scan

ORIGIN = np.int16  # of the indices of targets in info
OBSERVED = "detections", "truth"
EXTENT = 1e7  # m and m/s: no coordinate, velocity or estimate in any scenario comes near


class DrawnEnv(gym.Env):
    """An environment that can be rendered. A subclass makes the canvas and draws on it."""

    metadata = {  # noqa: RUF012, gymnasium declares it so
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
    }

    def __init__(self, render_mode: str | None):
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be one of {self.metadata['render_modes']}, got {render_mode!r}"
            )
        self.render_mode = render_mode
        self._canvas: Any = None

    def render(self):
        """Render the current scan.

        Returns
        -------
        ndarray (height, width, 3) or None
            None for "human", where the image is shown in a window, and without a render mode.

        Raises
        ------
        RuntimeError
            Before the first `reset`.
        """
        if self.render_mode is None:
            gym.logger.warn("render() needs a render_mode: pass render_mode='rgb_array' to make()")
            return None
        if not self._has_begun():
            raise RuntimeError("call reset() before render(): there is no scan yet")
        if self._canvas is None:
            self._canvas = self._new_canvas(on_screen=self.render_mode == "human")
        return self._drawn_on(self._canvas)

    def close(self):
        """Close the window, if one is open."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def _has_begun(self) -> bool:
        """Whether an episode has been begun."""
        raise NotImplementedError

    def _new_canvas(self, on_screen: bool) -> Any:
        """The canvas that draws episodes; imported when it is first needed."""
        raise NotImplementedError

    def _drawn_on(self, canvas: Any) -> np.ndarray | None:
        """The image of the current scan, None where it is shown in a window."""
        raise NotImplementedError


class EpisodicEnv(DrawnEnv):
    """An environment that draws an episode at `reset` and emits one scan of it at every step.

    A subclass declares the spaces, scores actions, and defines its episodes by the methods at the end.
    """

    def __init__(self, scenario: str, render_mode: str | None, observe: str, arguments: dict[str, Any]):
        super().__init__(render_mode)
        check_choice("observe", observe, OBSERVED)
        self.shows_truth = observe == "truth"
        check_keywords(arguments, [*settings(scenario), *keywords(type(self))])
        self.scenario: Any = make_scenario(scenario, arguments)
        self._position = list(self.scenario.position)
        self._capacity: int  # rows of a scan
        self._episode: Any
        self._estimates: list[np.ndarray]
        self._t = self.scenario.horizon  # no episode is running
        self._shown = -1  # the scan last emitted

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Decides the episode alone. Without one the random stream goes on.
        options : dict, optional
            Not used.

        Returns
        -------
        observation, info : dict
            Of scan 1.
        """
        super().reset(seed=seed)
        self._episode = self._drawn(seed if seed is not None else int(self.np_random.integers(2**63)))
        self._t, self._estimates = 0, []
        return self._emit()

    def _emit(self):
        """Observation and info of scan t, empty past the last; rendered for "human"."""
        t = self._t
        z = np.zeros((self._capacity, len(self.scenario.sensor.R)))
        mask = np.zeros(self._capacity, np.int8)
        info: dict[str, Any] = {}
        if t < self.scenario.horizon:
            seen = self._seen(t)
            self._shown, k = t, len(seen.z)
            z[:k] = seen.z
            mask[:k] = 1
            origin = np.full(self._capacity, -2, ORIGIN)
            origin[:k] = seen.origin
            info = self._truth(t) | {"origin": origin}
        if self.render_mode == "human":
            self.render()
        observation = {"scan": z, "mask": mask, "time": np.array([(t + 1) * self.scenario.period])}
        return observation | (self._state(t) if self.shows_truth else {}), info

    def _checked(self, action) -> np.ndarray:
        """The action as floats; RuntimeError where no episode is running, ValueError for a wrong shape."""
        if self._t >= self.scenario.horizon:
            raise RuntimeError("call reset() before step(): no episode is running")
        check_unmasked("action", action)
        try:
            action = np.array(action)
            if action.dtype != float:
                action = action.astype(float, casting="same_kind")
        except (TypeError, ValueError):
            raise ValueError(f"action must be numbers of shape {self.action_space.shape}") from None
        if action.shape != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {action.shape}")
        return action

    def _drawn(self, seed: int) -> Any:
        """All that chance decides in the episode of a seed."""
        raise NotImplementedError

    def _seen(self, t: int) -> Scan:
        """Scan t (from 0) of the episode."""
        raise NotImplementedError

    def _truth(self, t: int) -> dict[str, Any]:
        """What info contains of the targets at scan t."""
        raise NotImplementedError

    def _state(self, t: int) -> dict[str, np.ndarray]:
        """What an observation of scan t has besides, with observe="truth"; zeros past the last."""
        raise NotImplementedError

    def _has_begun(self) -> bool:
        return self._shown >= 0

    def _drawn_on(self, canvas: Any) -> np.ndarray | None:
        from gmr_gym.envs.render import Tracked

        t = self._shown
        return canvas.draw(self._episode, t, [Tracked(self._seen(t), self._estimates)])


def make_scenario(scenario: str, arguments: Mapping[str, Any]) -> Any:
    """Make a scenario from its settings.

    Parameters
    ----------
    scenario : str
        "module:function".
    arguments : mapping of str to object
        Keyword arguments of the function.

    Returns
    -------
    Scenario or MultiTargetScenario

    Raises
    ------
    ValueError
        For an unknown keyword, or one of the wrong type.
    """
    check_keywords(arguments, settings(scenario))
    takes = signature(_factory(scenario)).parameters
    for name, value in arguments.items():
        _check_number(name, value, takes[name].annotation)
    try:
        return _factory(scenario)(**arguments)
    except TypeError as error:  # such as text in place of a number, or a fraction in place of a whole number
        raise ValueError(f"cannot make a scenario of {arguments}: {error}") from None


def _check_number(name: str, value: Any, annotation: Any) -> None:
    """ValueError naming the setting where its annotation takes numbers alone, or None, and the value is
    neither."""
    kinds = {*annotation.__args__} if isinstance(annotation, UnionType) else {annotation}
    numeric = kinds - {NoneType} and not kinds - {float, int, NoneType}
    array = isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "biuf"
    if numeric and not (array or isinstance(value, Real) or (value is None and NoneType in kinds)):
        raise ValueError(f"{name} must be {'a' if float in kinds else 'a whole'} number, got {value!r}")


def settings(scenario: str) -> list[str]:
    """Names of the keywords that "module:function" takes."""
    return list(signature(_factory(scenario)).parameters)


def keywords(environment: type) -> list[str]:
    """Names of the keywords that an environment itself takes."""
    takes = signature(environment).parameters.values()
    return [each.name for each in takes if each.kind is not each.VAR_KEYWORD and each.name != "scenario"]


def check_keywords(given: Iterable[str], takes: Sequence[str]) -> None:
    """Check that keywords are known.

    Parameters
    ----------
    given : iterable of str
    takes : sequence of str
        The known keywords.

    Raises
    ------
    ValueError
        For an unknown keyword, naming the nearest known one, if one is near, and all of them.
    """
    for name in given:
        if name not in takes:
            near = get_close_matches(name, takes, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ValueError(f"unknown argument {name!r}; {hint}this environment takes {', '.join(takes)}")


def _factory(scenario: str) -> Callable:
    module, _, function = scenario.partition(":")
    return getattr(import_module(module), function)
