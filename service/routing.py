"""`Router`: the routes of one subject, shared by all applications of this process."""

from __future__ import annotations

from enum import Enum

from fastapi import APIRouter

from service.access.admission import AdmittedRoute
from service.errors import PROBLEM_RESPONSES


class Router(APIRouter):
    """A router whose routes may answer with a problem, and are admitted by their cost (`service.access.admission`); the
    name of a function is its operation's id.

    `create_app` adds these route objects to an application. `FastAPI.include_router` would read the parameters of all
    functions a second time, and build their validators, at the first request to each application (180 ms of CPU time),
    and match each request twice.

    Args:
        prefix: prefix of each path.
        tags: tags of each operation.
        include_in_schema: whether the OpenAPI document has these operations.
    """

    def __init__(self, prefix: str = "", tags: list[str | Enum] | None = None, include_in_schema: bool = True) -> None:
        super().__init__(
            prefix=prefix,
            tags=tags,
            include_in_schema=include_in_schema,
            responses=PROBLEM_RESPONSES,
            route_class=AdmittedRoute,
            generate_unique_id_function=lambda route: route.name,
        )
