"""`Router`: the routes of one subject, which every application of this process has as they are."""

from __future__ import annotations

from enum import Enum

from fastapi import APIRouter

from service.errors import PROBLEM_RESPONSES


class Router(APIRouter):
    """Any of its routes may answer with a problem; the name of a function is its operation's id.

    `create_app` gives an application these routes themselves. `FastAPI.include_router` would read the parameters of all
    functions a second time, and build their validators, at the first request to each application (180 ms of CPU time),
    and match each request twice.

    Args:
        prefix: of each path.
        tags: of each operation.
        include_in_schema: whether the OpenAPI document has these operations.
    """

    def __init__(self, prefix: str = "", tags: list[str | Enum] | None = None, include_in_schema: bool = True) -> None:
        super().__init__(
            prefix=prefix,
            tags=tags,
            include_in_schema=include_in_schema,
            responses=PROBLEM_RESPONSES,
            generate_unique_id_function=lambda route: route.name,
        )
