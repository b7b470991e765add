"""An episode as a film: clutter, gates, hypotheses, truth, estimate, hypotheses over time."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from gmr_gym.envs.render import INKS, PAPER, Canvas
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.multi_target_runs import play as play_multi_target
from gmr_gym.evaluation.writing import whole
from gmr_gym.filters.tracker import MultiTargetTracker, Tracker
from gmr_gym.simulation import multi_target as crowd
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario, draw

COLOURS = 64  # of a .gif
TINTS = 1.0, 0.8, 0.6, 0.4, 0.2  # shares of an ink in a pixel at an edge of what it draws


def film(
    scenario: Scenario | MultiTargetScenario,
    tracker: Tracker | MultiTargetTracker,
    seed: int,
    out: Path | str,
    *,
    title: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Writes the episode that `seed` draws, tracked, to a .gif or .mp4 file.

    Raises ValueError for another ending, and ImportError when a .mp4 needs the extra `video`.
    """
    out = Path(out)
    write = {".gif": _gif, ".mp4": _mp4}.get(out.suffix.lower())
    if write is None:
        raise ValueError(f"out must end in .gif or .mp4, got {out.name!r}")
    pictures = _many if isinstance(scenario, MultiTargetScenario) else _single
    frames = []
    for frame, total in pictures(scenario, tracker, seed, title):
        frames.append(frame)
        if progress:
            progress(len(frames), total)
    with whole(out) as partial:
        write(partial, frames)


def _single(scenario, tracker, seed: int, title: str) -> Iterator[tuple[np.ndarray | None, int]]:
    """Every picture of an episode of one target, and how many there are."""
    episode, canvas = draw(scenario, seed), Canvas(scenario, title=title)
    estimates: list[np.ndarray] = []
    for t, seen, report, _ in play(scenario, tracker, episode):
        estimates.append(report.x[0])
        yield canvas.draw(episode, seen, t, estimates, report), len(episode.x)


def _many(scenario, tracker, seed: int, title: str) -> Iterator[tuple[np.ndarray | None, int]]:
    """The same of many targets."""
    episode, canvas = crowd.draw(scenario, seed), MultiTargetCanvas(scenario, title=title)
    estimates: list[np.ndarray] = []
    for t, (account, _) in enumerate(play_multi_target(tracker, episode)):
        estimates.append(account.x[:, list(scenario.position)])
        yield canvas.draw(episode, crowd.scan(episode, t), t, estimates, account), len(episode.x)


def _gif(out: Path, frames: list) -> None:
    from PIL import Image

    # one palette for the whole film: colours do not flicker and the file stays small
    numbers = [frame.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32) for frame in frames]
    there = np.zeros(1 << 24, bool)
    for number in numbers:
        there[number] = True
    every = np.flatnonzero(there)
    colours = np.stack([every >> 16, every >> 8 & 255, every & 255], axis=1)
    palette = _palette(colours)
    nearest = np.zeros(1 << 24, np.uint8)
    nearest[every] = cKDTree(palette).query(colours)[1]
    first, *rest = (Image.fromarray(nearest[number]) for number in numbers)
    for image in (first, *rest):
        image.putpalette(palette.tobytes())
    first.save(out, save_all=True, append_images=rest, duration=120, loop=0)


def _palette(colours: np.ndarray) -> np.ndarray:
    """At most COLOURS (m, 3) for the colours (n, 3): the inks, however little they cover, as they are and
    as their edges fade into paper, and what stands for all others, of which each counts once."""
    from PIL import Image, ImageColor

    *inks, paper = np.array([ImageColor.getrgb(ink) for ink in (*INKS, PAPER)], float)
    tints = np.vstack([paper, *(paper + share * (np.array(inks) - paper) for share in TINTS)])
    row = Image.fromarray(colours.astype(np.uint8)[None])
    mixed = row.quantize(COLOURS - len(tints)).getpalette()
    return np.unique(np.vstack([tints.round(), np.array(mixed).reshape(-1, 3)]).astype(np.uint8), axis=0)


def _mp4(out: Path, frames: list) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        raise ImportError("a .mp4 needs the extra `video`: pip install imageio-ffmpeg") from None
    height, width = (side - side % 2 for side in frames[0].shape[:2])
    stream = write_frames(str(out), (width, height), fps=8, macro_block_size=2)
    stream.send(None)
    for frame in frames:
        stream.send(np.ascontiguousarray(frame[:height, :width]))
    stream.close()
