"""What a task of the step `synthesise` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import device
from pipeline.frames import Frame
from pipeline.methods.analogy.interval import KeyedShot, Piece, painted
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import Job
from pipeline.methods.analogy.shots import Shot, Stills, levels_of, matching
from pipeline.methods.analogy.styles import Pair, Styles, given_guides, goal_of, read_pair
from pipeline.methods.base import Bench, Note, Task
from pipeline.synthesis.atlas import coarser
from pipeline.synthesis.engine import colours, show
from pipeline.synthesis.images import NOWHERE, Bytes, Offsets
from pipeline.synthesis.keeping import kept, restored
from pipeline.synthesis.opencl import Kernels
from pipeline.synthesis.operations import Loaded, Sitting
from pipeline.synthesis.sweeps import Rounds, Seated, Sweep, carried_ribbons, order
from pipeline.synthesis.tones import Matched, Tones, tones_of

COARSE_ROUNDS = 2
"""Times as many iterations at the coarsest level, where all begins at random and a round costs next to nothing."""
STEP = "synthesise"


def run_synthesis(task: Task, bench: Bench) -> Note:
    """One run of one sweep, or frames on their own."""
    if "piece" in task.args:
        return run_piece(task, bench)
    job = Job(**task.args)
    studio = Studio(bench)
    if job.level < 0:
        studio.alone(job)
    elif job.level >= studio.levels:
        studio.pass_on(task.key)
    else:
        studio.sweep(task.key, job)
    return {"frames": job.stop - job.start}


def run_piece(task: Task, bench: Bench) -> Note:
    """The frames between two keys, or a part of them."""
    found = dict(task.args["piece"])
    piece = Piece(**{**found, "keys": tuple(found["keys"])})
    KeyedStudio(bench, piece).paint(task.key)
    return {"frames": piece.last - piece.first}


class Studio:
    """A task's style and device."""

    keyed = False

    def __init__(self, bench: Bench, pair: Pair | None = None) -> None:
        self.bench = bench
        self.params: AnalogyParams = bench.params
        with bench.clock("style"):
            self.pair = pair or read_pair(bench)
            self.styles = Styles(self.pair, self.params)
        self.levels = levels_of(self.params, bench.size, min(self.pair.output.shape[:2]))
        self.guides = given_guides(bench)
        self.ops = Kernels(device())
        self._loaded: dict[int, Loaded[Any]] = {}

    def style(self, level: int) -> Loaded[Any]:
        if level not in self._loaded:
            with self.bench.clock("style"):
                goal = goal_of(self.params, self.guides, level, keyed=self.keyed)
                self._loaded[level] = self.ops.load(self.styles.at(level, goal), goal)
        return self._loaded[level]

    def match(self) -> Callable[[Bytes], Bytes]:
        tones = self.bench.load("scan", "tones")
        return matching(self.params, self.pair, tones)

    def rounds(self, level: int, stream: int) -> Rounds:
        coarsest = level == self.levels - 1
        iterations = self.params.iterations * (COARSE_ROUNDS if coarsest else 1)
        reach = float(max(self.style(level).size)) if coarsest else self.params.search_radius
        return Rounds(iterations, reach, self.bench.seed & 0xFFFFFFFF, stream)

    # -- each frame on its own

    def alone(self, job: Job) -> None:
        """Synthesise each frame from coarse to fine and emit it."""
        match = self.match()
        for index in range(job.start, job.stop):
            stills = [Stills(self.bench, index, index + 1, level, match) for level in range(self.levels)]
            frame = self._still(index, stills, (index - job.start) / (job.stop - job.start))
            self.bench.emit(index, frame)
            self.bench.progress((index + 1 - job.start) / (job.stop - job.start))

    def _still(self, index: int, stills: list[Stills], done: float) -> Frame:
        above: tuple[int, Seated[Any]] | None = None
        for level in reversed(range(self.levels)):
            shot = Shot(stills[level], self.params, self.bench.clock)
            known = self._upsampled(above)
            sweep = Sweep(self.ops, self.style(level), shot, known, self.rounds(level, 64 + level), True)
            with self.bench.clock("synthesis"):
                above = level, next(sweep.run([index]))
                self.ops.device.finish()
            self.bench.progress(done)
        assert above is not None
        return self._shown(0, above[1].offsets)

    def _upsampled(self, above: tuple[int, Seated[Any]] | None) -> Callable[[int, Sitting[Any]], Any]:
        def known(_: int, sitting: Sitting[Any]) -> Any:
            if above is None:
                return None
            level, seen = above
            return self.ops.upsample(self.style(level), seen.sitting, seen.offsets, self.style(level - 1), sitting)

        return known

    def _shown(self, level: int, offsets: Any) -> Frame:
        return show(self.ops, self.style(level), offsets)

    # -- a run of a sweep

    def sweep(self, key: str, job: Job) -> None:
        """Frames [start, stop) in the sweep's order, from what earlier tasks have saved; save or emit them."""
        edge = job.start - 1 if job.forward else job.stop
        first = max(job.start - 1, job.begin) if job.forward else job.start
        last = job.stop if job.forward else min(job.stop + 1, job.end)
        match = self.match()
        stills = Stills(self.bench, first, last, job.level, match)
        before = self._before(job, match)
        sweep = Sweep(
            self.ops, self.style(job.level), Shot(stills, self.params, self.bench.clock), before,
            self.rounds(job.level, job.level * 8 + job.sweep), job.forward, keep_first=job.sweep > 0,
        )  # fmt: skip
        if job.neighbour:
            sitting = self.ops.seat(self.style(job.level), stills.target(edge))
            sweep.last = Seated(edge, sitting, self._restore(f"{job.neighbour}-edge", edge, job.level))
        found = self._collect(sweep, job)
        self._hand_over(key, job, found)

    def _before(self, job: Job, match: Callable[[Bytes], Bytes]) -> Callable[[int, Sitting[Any]], Any]:
        """What is known of a frame: the sweep before, or the coarser level, whose sittings only its directions need."""
        if job.first or not job.known or (job.coarser and job.level + 1 >= self.levels):
            return lambda index, sitting: None
        saved = self.bench.load(STEP, job.known)
        if not job.coarser:
            return lambda index, sitting: self.ops.upload(self._offsets(saved, index, job.level))
        above = Stills(self.bench, job.start, job.stop, job.level + 1, match)

        def known(index: int, sitting: Sitting[Any]) -> Any:
            seat = self.ops.seat(self.style(job.level + 1), above.target(index))
            seen = Seated(index, seat, self.ops.upload(self._offsets(saved, index, job.level + 1)))
            return self._upsampled((job.level + 1, seen))(index, sitting)

        return known

    def _longest(self, level: int) -> int:
        return max(self.style(level).size)

    def _offsets(self, saved: Mapping[str, NDArray[Any]], index: int, level: int) -> Offsets:
        return restored(saved[str(index)], self._longest(level))

    def _restore(self, name: str, index: int, level: int) -> Any:
        return self.ops.upload(self._offsets(self.bench.load(STEP, name), index, level))

    def _collect(self, sweep: Sweep[Any], job: Job) -> dict[int, Offsets]:
        """Run it."""
        found: dict[int, Offsets] = {}
        count = job.stop - job.start
        steps = iter(sweep.run(order(job.start, job.stop, job.forward)))
        for done in range(count):
            with self.bench.clock("synthesis"):
                seen = next(steps)
                found[seen.index] = self.ops.fetch(seen.offsets)
            self.bench.progress((done + 1) / count)
        return found

    def _hand_over(self, key: str, job: Job, found: dict[int, Offsets]) -> None:
        longest = self._longest(job.level)
        edge = job.stop - 1 if job.forward else job.start
        if job.last:
            self.bench.save(f"{key}-edge", {str(edge): kept(found[edge], longest)})
            for index in range(job.start, job.stop):
                self.bench.emit(index, self._painted(found[index]))
            return
        self.bench.save(key, {str(index): kept(offsets, longest) for index, offsets in found.items()})
        self.bench.save(f"{key}-edge", {str(edge): kept(found[edge], longest)})

    def _painted(self, offsets: Offsets) -> Frame:
        return np.ascontiguousarray(colours(self.style(0).style, offsets)[..., :3])

    def pass_on(self, key: str) -> None:
        """A level coarser than fits: nothing to do."""
        self.bench.progress(1.0)


class KeyedStudio(Studio):
    """A piece between keys: their paintings are the style, and are matched exactly."""

    keyed = True

    def __init__(self, bench: Bench, piece: Piece) -> None:
        params: AnalogyParams = bench.params
        levels = levels_of(params, bench.size, min(bench.size))
        pad = goal_of(params, given_guides(bench), 0).pad
        extra = _beside(bench) if bench.has("style_output") else None
        found = painted(bench, piece, levels, pad, lambda guide: guide, extra)
        super().__init__(bench, found.pair)
        self.levels, self.piece, self._given = levels, piece, found.given
        if piece.held >= 0:
            self._given[piece.held] = restored(
                bench.load(STEP, f"{piece.task}-edge")[str(piece.held)], self._longest(0)
            )

    def paint(self, key: str) -> None:
        """All levels and sweeps, then emit, and save the frame that the next piece goes on from."""
        state: dict[int, Seated[Any]] = {}
        for level in reversed(range(self.levels)):
            state = self._level(level, state)
        piece = self.piece
        for index in range(piece.first, piece.last):
            self.bench.emit(index, self._shown(0, state[index].offsets))
        ends = {piece.start, piece.last} & set(state)
        longest = self._longest(0)
        edge = {str(i): kept(self.ops.fetch(state[i].offsets), longest) for i in sorted(ends)}
        self.bench.save(f"{key}-edge", edge)

    def _level(self, level: int, above: dict[int, Seated[Any]]) -> dict[int, Seated[Any]]:
        piece, style = self.piece, self.style(level)
        stills = Stills(self.bench, piece.start, piece.stop, level, lambda guide: guide)
        shot = KeyedShot(stills, self.params, self.bench.clock, self._given, level)
        self._lay_ribbons(shot, level)
        for sweep in range(2 * self.params.sweeps):
            forward = sweep % 2 == 0
            known = self._known(level, above, coarser_level=sweep == 0)
            rounds = self.rounds(level, level * 8 + sweep)
            at_work = Sweep(self.ops, style, shot, known, rounds, forward, keep_first=sweep > 0)
            above = self._swept(at_work, forward, (self.levels - 1 - level) * 2 * self.params.sweeps + sweep)
        return above

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


def _beside(bench: Bench) -> Pair:
    """A style pair given beside keyframes. Its guide takes on the video's tones, as theirs have them."""
    pair = read_pair(bench)
    if not pair.derived or bench.params.tone_match == "off":
        return pair
    own = tones_of([pair.guide])
    return Pair(pair.output, Matched(own, Tones(**bench.load("scan", "tones")))(pair.guide), True, pair.extra)
