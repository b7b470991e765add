"""An episode as a film, or a scan of it as a picture: what the sensor saw, and what trackers made of it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gmr_gym.envs.render import Canvas, Tracked
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.envs.render_sheet import HYPOTHESIS, INKS, PAPER, check_size
from gmr_gym.evaluation.loop import is_off_target, play
from gmr_gym.evaluation.multi_target_runs import play as play_multi_target
from gmr_gym.evaluation.writing import whole
from gmr_gym.replay.recording import MOST_TRACKERS
from gmr_gym.simulation import multi_target, single_target
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

FPS, FASTEST = 10.0, 50.0  # frames a second; a .gif counts time in hundredths of a second
STAYS = 1.5  # seconds, that the last frame of a .gif is shown
WIDTH, NARROW = 640, 480  # pixels, of one panel, and of each of several
# shares of an ink in a pixel at an edge of what it draws; and of the one whose faintness says something
TINTS, FAINT = (1.0, 0.7, 0.4, 0.15), (1.0, 0.86, 0.72, 0.58, 0.45, 0.33, 0.22, 0.13, 0.06)
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
        For another ending or number of trackers, a picture without `frame` or a film with one, a frame or
        scans beyond the episode, a size above 4000 pixels or too small, and another fps.
    ImportError
        When a .mp4 needs the extra `video`.
    """
    out = Path(out)
    check_film(out, len(trackers), frame, size, fps)
    many = isinstance(scenario, MultiTargetScenario)
    kind: Any = multi_target if many else single_target
    episode = kind.draw(scenario, seed)
    total = _total(len(episode.x), frame, scans)
    canvas = (MultiTargetCanvas if many else Canvas)(
        scenario, titles=[*trackers], tracked=True, scans=scans,
        size=size or (WIDTH if len(trackers) == 1 else NARROW * len(trackers), 0),
    )  # fmt: skip
    play_one: Any = _many if many else _single
    tracked = [play_one(scenario, tracker, episode) for tracker in trackers.values()]

    def pictures() -> Iterator[Any]:
        for t, shown in enumerate(islice(zip(*tracked, strict=True), total)):
            if frame is None:
                yield canvas.draw(episode, t, shown)
            elif t == total - 1:
                canvas.place(episode, t, shown)
            if progress:
                progress(t + 1, total)

    if frame is None:
        write(out, pictures(), total, fps)
    else:
        for _ in pictures():
            pass
        with whole(out) as partial:
            canvas.save(partial)


def check_film(out: Path, trackers: int, frame: int | None, size: tuple[int, int] | None, fps: float) -> None:
    """ValueError or ImportError for what no film can be made of, as `film`, before anything is drawn."""
    ending = out.suffix.lower()
    if ending not in (*FILMS, *PICTURES):
        raise ValueError(f"out must end in {', '.join(FILMS)}, {' or '.join(PICTURES)}, got {out.name!r}")
    if ending in PICTURES and frame is None:
        raise ValueError(f"{out.name} is one picture: say of which scan by frame (--frame K), from 1")
    if ending in FILMS and frame is not None:
        raise ValueError(f"frame is for one picture, .png or .svg, got {out.name!r}")
    if not 1 <= trackers <= MOST_TRACKERS:
        raise ValueError(f"trackers must be from 1 to {MOST_TRACKERS}, got {trackers}")
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
        (_gif if out.suffix.lower() == ".gif" else _mp4)(partial, pictures, total, fps)


def _total(there: int, frame: int | None, scans: int | None) -> int:
    """Scans to be played."""
    if scans is not None and not 1 <= scans <= there:
        raise ValueError(f"scans must be from 1 to the {there} of the episode, got {scans}")
    there = scans or there
    if frame is not None and not 1 <= frame <= there:
        raise ValueError(f"frame must be from 1 to the {there} scans of the episode, got {frame}")
    return frame or there


def _single(scenario: Scenario, tracker: Any, episode: Any) -> Iterator[Tracked]:
    """Every scan of an episode of one target, as a tracker has it."""
    estimates, counts, off, lost_at = [], [], 0, -1
    for t, seen, report, _ in play(scenario, tracker, episode):
        estimates.append(report.x[0])
        counts.append(len(report.mixture.w))
        points = tracker.model.sensor.to_gate_space(seen.z)
        off = off + 1 if is_off_target(scenario, report, episode.x[t], points, seen.origin) else 0
        lost_at = t if lost_at < 0 and off >= scenario.patience else lost_at
        yield Tracked(seen, estimates, report, counts, lost_at)


def _many(scenario: MultiTargetScenario, tracker: Any, episode: Any) -> Iterator[Tracked]:
    """The same of many targets."""
    estimates: list[np.ndarray] = []
    for t, (report, _) in enumerate(play_multi_target(tracker, episode)):
        estimates.append(report.x[:, list(scenario.position)])
        yield Tracked(multi_target.scan(episode, t), estimates, report)


class Palette:
    """The colours of a .gif, the same for every film: inks as they are, their tints, and what two of them mix
    to. So no colour flickers, and one that covers little is there from the first frame to the last.

    Attributes
    ----------
    colours : ndarray (n, 3)
    """

    def __init__(self) -> None:
        from PIL import ImageColor

        *inks, paper = np.array([ImageColor.getrgb(ink) for ink in (*INKS, PAPER)], float)
        shares = [FAINT if ink == HYPOTHESIS else TINTS for ink in INKS]
        tints = [paper + s * (ink - paper) for ink, own in zip(inks, shares, strict=True) for s in own]
        mixed = [(one + other) / 2 for one, other in combinations(inks, 2)]
        self.colours = np.round([paper, *tints, *mixed]).astype(np.uint8)
        self._tree = cKDTree(self.colours)
        self._nearest = np.full(1 << 24, len(self.colours), np.uint8)  # by colour, where it has been met

    def indices(self, picture: np.ndarray) -> np.ndarray:
        """Rows of `colours` (height, width), the nearest to each pixel of a picture."""
        numbers = picture.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        new = np.unique(numbers[self._nearest[numbers] == len(self.colours)])
        self._nearest[new] = self._tree.query(np.stack([new >> 16, new >> 8 & 255, new & 255], axis=1))[1]
        return self._nearest[numbers]


def _gif(out: Path, pictures: Iterable[np.ndarray], total: int, fps: float) -> None:
    """Each frame is the part that differs from the frame before, see-through where it does not."""
    from PIL import Image
    from PIL.GifImagePlugin import getdata, getheader

    palette = Palette()
    clear, colours = len(palette.colours), palette.colours.tobytes() + bytes(3)
    before = None
    with out.open("wb") as file:
        for i, picture in enumerate(pictures):
            now = palette.indices(picture)
            rows, columns = _differing(now, before)
            part = now[rows, columns]
            if before is not None:
                part = np.where(part == before[rows, columns], clear, part).astype(np.uint8)
            image = Image.fromarray(part)
            image.putpalette(colours)
            if before is None:
                file.writelines(getheader(image, info={"loop": 0})[0])
            last = i == total - 1
            file.writelines(getdata(
                image, (columns.start, rows.start), transparency=clear, disposal=1,
                duration=round(100 / fps) * 10 + 1000 * STAYS * last,
            ))  # fmt: skip
            before = now
        file.write(b";")


def _differing(now: np.ndarray, before: np.ndarray | None) -> tuple[slice, slice]:
    """Rows and columns of the box in which two frames differ; one pixel where they do not."""
    if before is None:
        return slice(0, now.shape[0]), slice(0, now.shape[1])
    differs = now != before
    sides = (np.flatnonzero(differs.any(axis=axis)) for axis in (1, 0))
    rows, columns = (slice(side[0], side[-1] + 1) if len(side) else slice(0, 1) for side in sides)
    return rows, columns


def _mp4(out: Path, pictures: Iterable[np.ndarray], total: int, fps: float) -> None:
    stream: Any = None
    for picture in pictures:
        height, width = (side - side % 2 for side in picture.shape[:2])
        if stream is None:
            stream = _video()(str(out), (width, height), fps=fps, macro_block_size=2)
            stream.send(None)
        stream.send(np.ascontiguousarray(picture[:height, :width]))
    stream.close()


def _video() -> Callable[..., Any]:
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        raise ImportError("a .mp4 needs the extra `video`: pip install imageio-ffmpeg") from None
    return write_frames
