"""Videos in place of photographs: a selection of their frames is used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from pinholify.cli.options import progress, say
from pinholify.errors import InputError


@contextmanager
def stills_for_videos(files: Sequence[Path]) -> Iterator[list[Path]]:
    """``files`` with each video replaced by pictures of selected frames, which exist only within the block."""
    from pinholify.io.video.source import is_video

    videos = Counter(path.stem for path in files if is_video(str(path)))
    if not videos:
        yield list(files)
        return
    name, count = videos.most_common(1)[0]
    if count > 1:
        raise InputError(f"two videos are called '{name}'; rename one, so that their frames can be distinguished")
    with TemporaryDirectory(prefix="pinholify-") as folder:
        found: list[Path] = []
        for path in files:
            found += _stills(path, Path(folder)) if is_video(str(path)) else [path]
        yield found


def _stills(video: Path, folder: Path) -> list[Path]:
    """Write selected frames of ``video`` into ``folder``, named after the video and the frame's number."""
    from pinholify.io.images import write_image
    from pinholify.io.video.choice import choose_stills
    from pinholify.io.video.completeness import shortfall
    from pinholify.io.video.source import probe

    paths: list[Path] = []
    with progress(f"Choosing frames of {video.name}", probe(str(video)).frames) as advance:
        for still in choose_stills(str(video), on_frame=advance):
            paths.append(folder / f"{video.stem}-{still.number:06d}.png")
            write_image(paths[-1], still.image)
    say(f"chose {len(paths)} frames of {video}")
    if (lacking := shortfall(str(video))) is not None:
        say(f"note: {lacking.of(str(video))}")
    return paths
