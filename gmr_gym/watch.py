"""An episode as a film: clutter, gates, hypotheses, truth, estimate, hypotheses over time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gmr_gym.envs.render import Canvas
from gmr_gym.play import play
from gmr_gym.simulate import Scenario, draw
from gmr_gym.tracker import Tracker


def film(
    scenario: Scenario,
    tracker: Tracker,
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
    episode = draw(scenario, seed)
    canvas = Canvas(scenario, title=title)
    estimates, frames = [], []
    for t, seen, report, _ in play(scenario, tracker, episode):
        estimates.append(report.x[0])
        frames.append(canvas.draw(episode, seen, t, estimates, report))
        if progress:
            progress(t + 1, len(episode.x))
    out.parent.mkdir(parents=True, exist_ok=True)
    write(out, frames)


def _gif(out: Path, frames: list) -> None:
    from PIL import Image

    # one palette for the whole film: colours do not flicker and the file stays small
    palette = Image.fromarray(frames[-1]).quantize(64)
    plain = Image.Dither.NONE
    first, *rest = (Image.fromarray(frame).quantize(palette=palette, dither=plain) for frame in frames)
    first.save(out, save_all=True, append_images=rest, duration=120, loop=0, optimize=True)


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
