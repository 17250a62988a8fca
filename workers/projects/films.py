"""`farm.films`: the film of a project, which is the finished films of its shots, one after the other, in one file."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.formats import output_format
from workers.contract.record import Job, RunState
from workers.contract.request import OutputSpec
from workers.errors import Conflict, NotFound
from workers.farm_parts.assets import FarmAssets
from workers.farm_parts.files import FarmFiles
from workers.farm_parts.stored_file import StoredFile, asset_file
from workers.projects.faults import BadProject
from workers.projects.film_joins import FilmJoins
from workers.projects.joining import Chapter, ShotClip, chapters, joining_notes, joins
from workers.projects.projects import Projects

_LOOKED_AT = 3
"""Versions with submitted films among which the newest finished film is looked for."""
WAIT_S = 5.0
"""Time that a request waits for a join, seconds."""


@dataclass(frozen=True)
class ShotFilm:
    """A shot of a film. `job`: paints what the shot shows, finished or in work; None: there is none."""

    shot: str
    name: str
    job: Job | None

    @property
    def ready(self) -> bool:
        return self.job is not None and self.job.state is RunState.SUCCEEDED


@dataclass(frozen=True)
class ProjectFilm:
    """The film of a version of a project."""

    version: int
    name: str
    output: OutputSpec
    shots: tuple[ShotFilm, ...]
    notes: tuple[str, ...] = ()
    """How shots that differ are joined, in sentences."""
    chapters: tuple[Chapter, ...] = ()
    joined: float | None = None
    """The fraction of the join that is done, 0..1; None: there is nothing to join, or not yet."""

    @property
    def jobs(self) -> list[Job]:
        """The finished jobs of the shots."""
        return [shot.job for shot in self.shots if shot.job is not None and shot.ready]

    @property
    def ready(self) -> bool:
        """Whether the film of every shot is finished."""
        return bool(self.shots) and all(shot.ready for shot in self.shots)


class FarmFilms:
    """Finds the films of shots, and joins them."""

    def __init__(self, projects: Projects, assets: FarmAssets, files: FarmFiles, scratch: Path) -> None:
        self._projects, self._files = projects, files
        self._joins = FilmJoins(assets, files, scratch)

    def get(self, project_id: str, version: int | None = None) -> ProjectFilm:
        """The film of a version; None: the newest.

        Raises:
            NotFound: there is no such project or version.
            BadProject: its document has problems.
        """
        number, document, found = self._projects.films(project_id, version)
        names = {shot.id: shot.name or f"Shot {at}" for at, shot in enumerate(document.shots, start=1)}
        given = document.output
        output = OutputSpec(given.format, given.quality, profile=given.profile, alpha=given.alpha)
        shots = tuple(ShotFilm(shot, names[shot], job) for shot, job in found)
        assets = self._projects.assets(document.asset_ids, self._projects.get(project_id).owner)
        clips = [ShotClip.of(at, shot, document, assets) for at, shot in enumerate(document.shots, start=1)]
        film = ProjectFilm(number, document.name, output, shots, joining_notes(clips, output.encoding), chapters(clips))
        if not film.ready or len(shots) == 1 or not joins(output_format(output.format)):
            return film
        return replace(film, joined=self._joined(film.jobs, output))

    def newest(self, project_id: str) -> ProjectFilm | None:
        """The newest film whose shots are all finished: of the newest version, else of the last versions of which films
        were submitted; None: there is none. Raises NotFound."""
        newest = self._projects.get(project_id).version
        submitted = sorted({noted.version for noted, _ in self._projects.jobs(project_id)}, reverse=True)
        for version in dict.fromkeys((newest, *submitted[:_LOOKED_AT])):
            with suppress(BadProject, NotFound):
                if (film := self.get(project_id, version)).ready:
                    return film
        return None

    def file(self, project_id: str, version: int | None = None) -> StoredFile:
        """The film in one file: that of the only shot, or the joined one, which is made if it does not exist.

        Raises:
            Conflict: the film of a shot is not finished, the format cannot be joined, or the join takes longer than
                `WAIT_S`: it goes on, and is found later.
            NotFound, BadProject: as `get`.
            BadParameter, UnreadableMedia: as `assemble`.
        """
        film = self.get(project_id, version)
        jobs = film.jobs
        _check(film)
        form = output_format(film.output.format)
        name = f"{film.name}{form.suffixes[0]}"
        if len(jobs) == 1:
            return replace(self._files.get(jobs[0].id, "result"), filename=name)
        asset = self._joins.find(jobs, film.output) or self._joins.make(jobs, film.output, WAIT_S)
        if asset is None:
            done = self._joins.progress(jobs, film.output) or 0.0
            raise Conflict(
                f"The shots are being joined: {done:.0%} are done.", field="shots", value=round(done, 3),
                remedy="Ask again in some seconds; `joined` of the film tells how far it is.",
            )  # fmt: skip
        return replace(asset_file(asset), filename=name, media_type=form.media_type)

    def close(self) -> None:
        """Give up joins that are not finished."""
        self._joins.close()

    def _joined(self, jobs: Sequence[Job], output: OutputSpec) -> float:
        if self._joins.find(jobs, output) is not None:
            return 1.0
        return min(0.99, self._joins.progress(jobs, output) or 0.0)


def _check(film: ProjectFilm) -> None:
    waiting = [shot.name for shot in film.shots if not shot.ready]
    if waiting:
        raise Conflict(
            f"The film is not painted yet: {len(waiting)} of {len(film.shots)} shots are missing.", field="shots",
            value=", ".join(waiting)[:200], remedy="Submit the project with `changed`, and wait for its jobs.",
        )  # fmt: skip
    form = output_format(film.output.format)
    if len(film.shots) > 1 and not joins(form):
        raise Conflict(
            f"Films of several shots cannot be joined as {form.title}.", field="output.format", value=form.name,
            remedy="Download the films of the shots, or choose a video format.",
        )  # fmt: skip
