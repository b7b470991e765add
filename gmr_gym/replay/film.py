"""An episode as a film, or a scan of it as a picture: what the sensor saw, and what trackers made of it."""

import errno
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.envs.render import Canvas, Tracked
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.envs.render_sheet import check_size
from gmr_gym.evaluation.loop import is_off_target, play
from gmr_gym.evaluation.multi_target_runs import play as play_multi_target
from gmr_gym.evaluation.writing import whole
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.replay.columns import Reported
from gmr_gym.replay.gif import write_gif
from gmr_gym.replay.lineup import check_shown, scans_shown
from gmr_gym.replay.single_target import checked
from gmr_gym.simulation import multi_target, single_target
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

FPS, FASTEST = 10.0, 50.0  # frames a second; a .gif counts time in hundredths of a second
WIDTH, NARROW = 640, 480  # pixels, of one panel, and of each of several
FILMS, PICTURES = (".gif", ".mp4"), (".png", ".svg")


def film(
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    seed: int,
    out: Path | str,
    *,
    frame: int | None = None,
    scans: int | None = None,
    size: tuple[int, int] | None = None,
    fps: float = FPS,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the episode that `seed` draws, tracked, to a .gif or .mp4 file, or a scan to a .png or .svg.

    Frames are made one by one, and none is kept.

    Parameters
    ----------
    scenario : Scenario or MultiTargetScenario
    trackers : mapping of str to Tracker or MultiTargetTracker
        From 1 to 4 by title. Each has a panel; all show the same part of the plane.
    seed : int
    out : Path or str
    frame : int, optional
        The scan, from 1, of a picture.
    scans : int, optional
        The first scans of the episode; all by default.
    size : tuple of int, optional
        Width and height, pixels; a height of 0 is as the view has it.
    fps : float
        Frames a second; up to 50.
    progress : callable, optional
        Called with the numbers of scans done and of all.

    Raises
    ------
    ValueError
        For another ending, number of trackers or seed, a tracker that does not fit, a picture without `frame`
        or a film with one, a frame or scans beyond the episode, a size above 4000 pixels or too small,
        another fps, and reports of wrong shapes.
    ImportError
        When a .mp4 needs the extra `video`.
    OSError
        Naming the file.
    """
    out = Path(out)
    check_film(out, frame, size, fps)
    check_shown(trackers, seed, scenario)
    many = isinstance(scenario, MultiTargetScenario)
    kind: Any = multi_target if many else single_target
    episode = kind.draw(scenario, int(seed))
    total = _total(len(episode.x), frame, scans)
    canvas = (MultiTargetCanvas if many else Canvas)(
        scenario, titles=[*trackers], tracked=True, scans=scans,
        size=size or (WIDTH if len(trackers) == 1 else NARROW * len(trackers), 0),
    )  # fmt: skip
    play_one: Any = _many if many else _single
    tracked = [play_one(scenario, tracker, episode, name) for name, tracker in trackers.items()]

    moments = _moments(zip(*tracked, strict=True), total, progress)
    if frame is None:
        write(out, (canvas.draw(episode, t, shown) for t, shown in moments), total, fps)  # type: ignore[misc]
        return
    ((t, shown),) = deque(moments, maxlen=1)
    canvas.place(episode, t, shown)
    with whole(out) as partial:
        canvas.save(partial)


def check_film(out: Path, frame: int | None, size: tuple[int, int] | None, fps: float) -> None:
    """ValueError or ImportError for what no film can be made of, as `film`, before anything is drawn."""
    ending = out.suffix.lower()
    if ending not in (*FILMS, *PICTURES):
        raise ValueError(f"out must end in {', '.join(FILMS)}, {' or '.join(PICTURES)}, got {out.name!r}")
    if ending in PICTURES and frame is None:
        raise ValueError(f"{out.name} is one picture: say of which scan by frame (--frame K), from 1")
    if ending in FILMS and frame is not None:
        raise ValueError(f"frame is for one picture, .png or .svg, got {out.name!r}")
    if size is not None:
        check_size((size[0], size[1] or 1))
    if not 0.1 <= fps <= FASTEST:
        raise ValueError(f"fps must be between 0.1 and {FASTEST:g}, got {fps:g}")
    if ending == ".mp4":
        _video()


def write(out: Path | str, pictures: Iterable[np.ndarray], total: int, fps: float = FPS) -> None:
    """Write pictures to a .gif or .mp4 file, one by one.

    Parameters
    ----------
    out : Path or str
    pictures : iterable of ndarray (height, width, 3)
        All of one size.
    total : int
        How many there are: the last one of a .gif stays a moment.
    fps : float
        Frames a second.
    """
    out = Path(out)
    with whole(out) as partial:
        (write_gif if out.suffix.lower() == ".gif" else _mp4)(partial, pictures, total, fps)


def _total(there: int, frame: int | None, scans: int | None) -> int:
    """Scans to be played."""
    there = scans_shown(there, scans)
    if frame is not None and frame not in range(1, there + 1):
        raise ValueError(f"frame must be from 1 to the {there} scans of the episode, got {frame}")
    return there if frame is None else int(frame)


def _moments(
    shown: Iterable[tuple[Tracked, ...]], total: int, progress: Callable[[int, int], None] | None
) -> Iterator[tuple[int, tuple[Tracked, ...]]]:
    """The first scans, numbered from 0; `progress` is called after each."""
    for t, each in enumerate(islice(shown, total)):
        yield t, each
        if progress:
            progress(t + 1, total)


def _single(scenario: Scenario, tracker: Any, episode: Any, name: str = "") -> Iterator[Tracked]:
    """Every scan of an episode of one target, as a tracker has it."""
    reported, estimates, counts, off, lost_at = Reported(name), [], [], 0, -1
    for t, seen, given, _ in play(scenario, tracker, episode):
        reported.scan = t + 1
        report = checked(scenario, reported, given)
        estimates.append(report.x[0])
        counts.append(len(report.mixture.w))
        points = tracker.model.sensor.to_gate_space(seen.z)
        off = off + 1 if is_off_target(scenario, report, episode.x[t], points, seen.origin) else 0
        lost_at = t if lost_at < 0 and off >= scenario.patience else lost_at
        yield Tracked(seen, estimates, report, counts, lost_at)


def _many(scenario: MultiTargetScenario, tracker: Any, episode: Any, name: str = "") -> Iterator[Tracked]:
    """The same of many targets."""
    estimates: list[np.ndarray] = []
    reported = Reported(name)
    for t, (report, _) in enumerate(play_multi_target(tracker, episode)):
        reported.scan = t + 1
        reported.fields("report", report, MultiTargetReport)
        estimates.append(report.x[:, list(scenario.position)])
        yield Tracked(multi_target.scan(episode, t), estimates, report)


def _mp4(out: Path, pictures: Iterable[np.ndarray], total: int, fps: float) -> None:
    video = _video()
    stream: Any = None
    for picture in pictures:
        height, width = (side - side % 2 for side in picture.shape[:2])
        if stream is None:
            stream = video.write_frames(str(out), (width, height), fps=fps, macro_block_size=2)
            stream.send(None)
        stream.send(np.ascontiguousarray(picture[:height, :width]))
    stream.close()
    try:
        video.count_frames_and_secs(str(out))
    except RuntimeError:  # it does not say so itself
        raise OSError(errno.EIO, "ffmpeg could not write the film to its end", str(out)) from None


def _video() -> Any:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise ImportError("a .mp4 needs the extra `video`: pip install imageio-ffmpeg") from None
    return imageio_ffmpeg
