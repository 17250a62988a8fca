"""Path and query parameters, and response shapes, that several routers share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Generic, TypeVar

from fastapi import Path, Query

from workers.contract.request import Json

Item = TypeVar("Item")
Responses = dict[int | str, Json]
"""OpenAPI of a route's answers, by status."""

ID = r"^[A-Za-z0-9_-]{1,100}$"
FILE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,199}$"

AssetId = Annotated[str, Path(pattern=ID, description="An asset's id (`ast_...`).")]
JobId = Annotated[str, Path(pattern=ID, description="A job's id (`job_...`).")]
TaskId = Annotated[str, Path(pattern=ID, description="A task's id (`tsk_...`).")]
FileName = Annotated[str, Path(pattern=FILE_NAME, description="One of the job's `results`.")]
Cursor = Annotated[str | None, Query(max_length=500, description="`cursor` of the page before.")]
Limit = Annotated[int, Query(ge=1, le=200, description="Items a page at most.")]
Download = Annotated[bool, Query(description="Answer as an attachment, to be saved.")]


@dataclass(frozen=True)
class Listing(Generic[Item]):
    """One page; `cursor` requests the next one, and is null on the last."""

    items: tuple[Item, ...]
    cursor: str | None


def binary(media_type: str, text: str) -> Responses:
    """OpenAPI of an answer that is a file."""
    content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
    return {
        200: {"description": text, "content": content},
        206: {"description": "The requested range", "content": content},
        304: {"description": "The client has it already"},
    }
