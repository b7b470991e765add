"""What is assumed of a file of detections, proposed from the file itself."""

import math
import shlex
from collections.abc import Iterator
from pathlib import Path

from gmr_gym.experiments.tracks import are_reports
from gmr_gym.recorded.configuration import Configuration
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.proposal import Proposal, before_and_after, completed, propose
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.settings_file import write_configuration


def asks(settings: Configuration) -> bool:
    """Whether a deviation is `auto`."""
    return any(math.isnan(one) for sensor in settings.sensors for one in sensor.deviation.values())


def proposed(found: Detections, scans: list[Scan], settings: Configuration) -> tuple[Configuration, Proposal]:
    """The settings, with what is proposed for all that they do not say."""
    proposal = propose(found, scans, reports=are_reports(found, scans))
    return completed(settings, proposal), proposal


def write_proposal(
    out: Path, source: Path, found: Detections, scans: list[Scan], settings: Configuration
) -> Iterator[str]:
    """Write the settings, and say what is proposed, on what it rests, and how much better tracks are."""
    yield "tracking with rough numbers, and again with those found"
    settings, proposal = proposed(found, scans, settings)
    write_configuration(out, settings, [f"proposed from {source.name}", *proposal.lines])
    yield from (f"proposed: {line}" for line in proposal.lines)
    yield from before_and_after(proposal)
    command = shlex.join(["gmr-gym", "track", f"{source}", "--config", f"{out}"])
    yield f"written to {out}; track with {command}"
