"""Paintings that are shown for several frames ("on twos"). They are counted from the first frame of the shot, also in a
piece of a film, which may begin while one is shown."""

from __future__ import annotations

from pipeline.methods.base import VideoInfo


def painted_frame(frame: int, begin: int, length: int) -> int:
    """Number of the frame whose painting is shown at `frame`.

    Args:
        begin: first frame of the shot, or of what is painted independently of the frames before it.
        length: number of frames that show the same painting; 1: each frame has its own.
    """
    return frame - (frame - begin) % length


def first_scanned(video: VideoInfo, length: int) -> int:
    """First frame of the film that a scan must read: where paintings are held, all frames before a piece, because the
    first frame of its shot is known only from them."""
    return 0 if video.is_piece and length > 1 else video.first
