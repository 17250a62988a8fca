"""What a task between painted keys does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.methods.analogy.interval import KeyedShot, Piece, painted
from pipeline.methods.analogy.layers import Found
from pipeline.methods.analogy.opened import source_of
from pipeline.methods.analogy.shots import Stills, levels_of
from pipeline.methods.analogy.sources import Pair, Source
from pipeline.methods.analogy.studio import STEP, Studio
from pipeline.methods.analogy.styles import goal_of
from pipeline.methods.base import Bench, Note, Task
from pipeline.synthesis.atlas import coarser
from pipeline.synthesis.images import NOWHERE
from pipeline.synthesis.keeping import kept, restored
from pipeline.synthesis.operations import Sitting
from pipeline.synthesis.sweeps import Seated, Sweep, carried_ribbons, order
from pipeline.synthesis.tones import Matched, tones_of


def run_piece(task: Task, bench: Bench) -> Note:
    """The frames between two keys, or a part of them."""
    found = dict(task.args["piece"])
    piece = Piece(**{**found, "keys": tuple(found["keys"])})
    studio = KeyedStudio(bench, piece)
    studio.paint(task.key)
    return studio.note(piece.last - piece.first)


class KeyedStudio(Studio):
    """A piece between keys: their paintings are the style, and are matched exactly."""

    keyed = True

    def __init__(self, bench: Bench, piece: Piece) -> None:
        source = source_of(bench, piece.layer, keyed=True)
        levels = levels_of(source.params, bench.size, min(bench.size))
        pad = goal_of(source.params, source.guides, 0).pad
        extra = _beside(bench, source) if source.layer < 0 and source.has_pair() else None
        found = painted(bench, source, piece, levels, pad, extra)
        self.piece = piece
        super().__init__(bench, source, found.pair)
        self.levels, self._given = levels, found.given
        if piece.held >= 0:
            edge = bench.load(STEP, f"{piece.task}-edge")[str(piece.held)]
            self._given[piece.held] = restored(edge, self._longest(0))

    def _frames_held(self) -> int:
        return self.piece.stop - self.piece.start

    def paint(self, key: str) -> None:
        """All levels and sweeps, then emit, and save the frame that the next piece goes on from."""
        state: dict[int, Seated[Any]] = {}
        piece = self.piece
        for level in reversed(range(self.levels)):
            state, stills = self._level(level, state)
            if level:
                self.preview(level, self.ops.fetch(state[(piece.first + piece.last) // 2].offsets))
        for index in range(piece.first, piece.last):
            self.hand_out(index, self.ops.fetch(state[index].offsets), stills)
        ends = {piece.start, piece.last} & set(state)
        longest = self._longest(0)
        edge = {str(i): kept(self.ops.fetch(state[i].offsets), longest) for i in sorted(ends)}
        self.bench.save(f"{key}-edge", edge)

    def _level(self, level: int, above: dict[int, Seated[Any]]) -> tuple[dict[int, Seated[Any]], Stills]:
        piece, style = self.piece, self.style(level)
        stills = self.stills(piece.start, piece.stop, level, lambda guide: guide)
        shot = KeyedShot(stills, self.bench.clock, style.style.first, self._given, level)
        self._lay_ribbons(shot, level)
        for sweep in range(2 * self.params.sweeps):
            forward = sweep % 2 == 0
            known = self._known(level, above, coarser_level=sweep == 0)
            rounds = self.rounds(level, level * 8 + sweep)
            at_work = Sweep(self.ops, style, shot, known, rounds, forward, keep_first=sweep > 0)
            above = self._swept(at_work, forward, (self.levels - 1 - level) * 2 * self.params.sweeps + sweep)
        return above, stills

    def _known(
        self, level: int, before: dict[int, Seated[Any]], coarser_level: bool
    ) -> Callable[[int, Sitting[Any]], Any]:
        def known(index: int, sitting: Sitting[Any]) -> Any:
            if index not in before:
                return None
            if coarser_level:
                return self._upsampled((level + 1, before[index]))(index, sitting)
            return before[index].offsets

        return known

    def _swept(self, sweep: Sweep[Any], forward: bool, number: int) -> dict[int, Seated[Any]]:
        found: dict[int, Seated[Any]] = {}
        total = self.levels * 2 * self.params.sweeps
        with self.bench.clock("synthesis"):
            for seen in sweep.run(order(self.piece.start, self.piece.stop, forward)):
                found[seen.index] = Seated(seen.index, _light(seen.sitting), seen.offsets)
                self.bench.progress(min(1.0, (number + 0.5) / total))
        return found

    def _lay_ribbons(self, shot: KeyedShot, level: int) -> None:
        """Each pixel's place in the piece's first and last frames, if they are painted all over."""
        piece = self.piece
        ends = [i for i in (piece.start, piece.stop - 1) if i in shot.full]
        for index in range(piece.start, piece.stop):
            width, height = shot.target(index).size
            shot.carried[index] = np.full((2, height, width, 2), NOWHERE, np.float32)
        for end in ends:
            way = range(end, piece.stop) if end == piece.start else range(end, piece.start - 1, -1)
            plane = 0 if end == piece.start else 1
            with self.bench.clock("ribbons"):
                start = coarser(self._given[end], level)
                for index, places in carried_ribbons(self.ops, self.style(level), shot, way, start):
                    shot.carried[index][plane] = places
        if not ends:
            shot.carried.clear()


def _light(sitting: Sitting[Any]) -> Sitting[Any]:
    """A finished frame's sitting without what only its own rounds needed."""
    return Sitting(sitting.size, sitting.field, sitting.field, sitting.bins)


def _beside(bench: Bench, source: Source) -> Pair:
    """A style pair given beside keyframes. Its guide takes on the video's tones, as theirs have them."""
    pair = source.pair()
    if not pair.derived or source.params.tone_match == "off":
        return pair
    found = Found.of(bench.load("scan", source.found))
    own = tones_of([pair.guide])
    return Pair(pair.output, Matched(own, found.tones)(pair.guide), True, pair.extra)
