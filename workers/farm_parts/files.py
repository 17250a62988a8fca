"""`farm.files`: results, posters, previews and artefacts of jobs, read as streams, local files or signed URLs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from pipeline.video.stills import encode_png
from workers.blobs.base import Blobs
from workers.blobs.verified import compared, hash_of_key
from workers.contract.record import Job
from workers.errors import Conflict, NotFound
from workers.execution.decoders import Decoders
from workers.farm_parts.stored_file import StoredFile, job_file
from workers.store import Store

_CHUNK_BYTES = 1 << 20


class FarmFiles:
    """
    Args:
        direct: whether clients may be sent to the blob store by signed URLs.
    """

    def __init__(self, store: Store, blobs: Blobs, direct: bool) -> None:
        self._store, self._blobs, self._direct = store, blobs, direct
        self._decoders = Decoders(blobs)

    def get(self, job_id: str, name: str) -> StoredFile:
        """A file of a job: "result", "poster" (JPEG), "sheet" (contact sheet, JPEG), "preview" (newest frame, JPEG),
        "report" (JSON), or an artefact's name.

        Raises:
            NotFound: there is no such job, or it ended without such a file.
            Conflict: the job has not made the file yet.
        """
        job = self._store.jobs.get(job_id)
        row = self._store.jobs.file(job_id, name)
        if row is not None:
            return job_file(job, row, self._blobs.size(row["key"]) or 0)
        if job.state.final:
            raise NotFound(f"The job has no file {name!r}.", field="name", value=name, remedy=_existing(job))
        raise Conflict(f"The file {name!r} is not there yet.", field="name", value=name, remedy="Wait for the job.")

    def read(self, file: StoredFile, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes [start, stop) in chunks.

        Raises:
            NotFound: the file has been deleted.
            DamagedBlob: before the last chunk of a whole asset whose bytes have changed.
        """
        try:
            pieces = self._blobs.read(file.key, start, stop, _CHUNK_BYTES)
        except KeyError:
            raise NotFound("The file has been deleted.", field="file", value=file.filename) from None
        whole = start == 0 and stop in (None, file.size_bytes)
        return compared(file.key, pieces) if whole and hash_of_key(file.key) else pieces

    def local(self, file: StoredFile) -> AbstractContextManager[Path]:
        """The file on this machine's disk while the context is open."""
        return self._blobs.local(file.key)

    def frame(self, file: StoredFile, index: int) -> bytes | None:
        """Frame `index` of a film at full size, PNG bytes; None beyond its end. Raises NotFound (deleted)."""
        try:
            with self._decoders.reader(file.key, index) as reader:
                found = next(reader.read(index, index + 1), None)
        except KeyError:
            raise NotFound("The file has been deleted.", field="file", value=file.filename) from None
        return None if found is None else encode_png(found)

    def close(self) -> None:
        self._decoders.close()

    def direct_url(self, file: StoredFile) -> str | None:
        """A signed URL of the blob store, valid for an hour; None where the operator has not enabled that."""
        direct = self._blobs.direct
        if direct is None or not self._direct:
            return None
        return direct.download_url(file.key, file.filename, file.media_type)


def _existing(job: Job) -> str:
    return f"There are: {', '.join(job.results)}." if job.results else "It has no files."
