"""A sink that shows frames in a window."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from impasto.live.sink import Sink
from impasto.live.sources import Size
from pipeline.errors import BadInput
from pipeline.frames import Frame

HELP = "q or Esc quits, f fills the screen, s shows the original beside, space freezes"


class Window(Sink):
    """Keys are in `HELP`."""

    needs_original = True

    def __init__(self, size: Size) -> None:
        self._game = _pygame()
        self._game.display.init()
        try:
            self._screen = self._game.display.set_mode(size, self._game.RESIZABLE)
        except self._game.error as error:
            raise BadInput(
                f"No window can be opened: {error}.", field="--output", value="window",
                remedy="Use a machine with a screen, or write to a file.",
            ) from None  # fmt: skip
        self._game.display.set_caption(f"Impasto live: {HELP}")
        self._beside = self._frozen = False

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        if not self._frozen:
            self._show(self._picture(frame, original))

    def is_open(self) -> bool:
        for event in self._game.event.get():
            if event.type == self._game.QUIT or (event.type == self._game.KEYDOWN and not self._press(event.key)):
                return False
        return True

    def _press(self, key: int) -> bool:
        game = self._game
        if key == game.K_f:
            game.display.toggle_fullscreen()
        elif key == game.K_s:
            self._beside = not self._beside
        elif key == game.K_SPACE:
            self._frozen = not self._frozen
        return key not in (game.K_q, game.K_ESCAPE)

    def _picture(self, frame: Frame, original: Frame | None) -> Frame:
        if not self._beside or original is None:
            return frame
        shown = cv2.resize(original, (frame.shape[1], frame.shape[0]), interpolation=cv2.INTER_AREA)
        return np.hstack([np.asarray(shown, np.uint8), frame])

    def _show(self, picture: Frame) -> None:
        """Centred, at the largest size that fits."""
        width, height = self._screen.get_size()
        scale = min(width / picture.shape[1], height / picture.shape[0])
        size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
        shown = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR), np.uint8)
        surface = self._game.image.frombuffer(shown.tobytes(), size, "RGB")
        self._screen.fill((0, 0, 0))
        self._screen.blit(surface, ((width - size[0]) // 2, (height - size[1]) // 2))
        self._game.display.flip()

    def finish(self, end_s: float) -> str:
        self._game.display.quit()
        return "window"


def _pygame() -> Any:
    try:
        import pygame
    except ImportError:
        raise BadInput(
            "A window needs the package pygame-ce.", field="--output", value="window",
            remedy="pip install 'impasto[window]', or write to a file.",
        ) from None  # fmt: skip
    return pygame
