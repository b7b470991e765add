"""Files that are written whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(file: Path | str) -> Iterator[Path]:
    """A temporary path beside `file`, with its ending, to write to.

    When the block ends, the temporary file replaces the file; when it raises, the temporary file is deleted
    and the file stays as it was. Missing folders are made. What is not a plain file, such as /dev/stdout, is
    written to directly.

    Parameters
    ----------
    file : Path or str

    Yields
    ------
    Path

    Raises
    ------
    OSError
        Naming the file.
    """
    file = Path(file)
    if file.exists() and not file.is_file():
        yield file
        return
    target = file.resolve()  # a link stays one
    partial = target.with_name(f"{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield partial
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:  # of a full disk the error names no file
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(file)) from error
