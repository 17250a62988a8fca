"""The OpenAPI document: valid, with unique titles, and examples that its own schemas accept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import jsonschema
import pytest
from fastapi.testclient import TestClient
from openapi_spec_validator import OpenAPIV31SpecValidator

from service.app import openapi_document
from workers.contract.request import Json


@pytest.fixture(scope="module")
def document() -> Json:
    return openapi_document()


def test_the_service_answers_with_this_document(client: TestClient, document: Json) -> None:
    assert client.get("/openapi.json").json() == document


def test_the_document_is_valid_openapi(document: Json) -> None:
    assert document["openapi"].startswith("3.1")
    assert [error.message for error in OpenAPIV31SpecValidator(document).iter_errors()] == []


def test_titles_and_operation_ids_are_unique(document: Json) -> None:
    titles = Counter(schema["title"] for schema in document["components"]["schemas"].values())
    operations = Counter(operation["operationId"] for operation in _operations(document))
    assert {**titles, **operations} == dict.fromkeys([*titles, *operations], 1)


def test_every_operation_and_tag_is_described_and_servers_are_named(document: Json) -> None:
    assert all(operation["description"] for operation in _operations(document))
    used = {tag for operation in _operations(document) for tag in operation["tags"]}
    assert used == {tag["name"] for tag in document["tags"] if tag["description"]}
    assert [server["url"] for server in document["servers"]] == ["/", "http://127.0.0.1:8420"]
    assert "POST /v1/jobs" in document["info"]["description"]


def test_every_json_body_has_an_example(document: Json) -> None:
    for operation in _operations(document):
        body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
        names = {part["$ref"].rpartition("/")[2] for part in [body, *body.get("anyOf", ())] if "$ref" in part}
        for name in names:
            assert document["components"]["schemas"][name].get("examples"), name


def test_every_example_fits_its_schema(document: Json) -> None:
    examples = {name: schema.get("examples", ()) for name, schema in document["components"]["schemas"].items()}
    assert sum(map(len, examples.values())) > 15
    for name, given in examples.items():
        schema = {"$ref": f"#/components/schemas/{name}", "components": document["components"]}
        for example in given:
            jsonschema.Draft202012Validator(schema).validate(example)


def test_answers_announce_every_field_that_they_always_have(document: Json) -> None:
    schemas = document["components"]["schemas"]
    assert set(schemas["Asset"]["required"]) == set(schemas["Asset"]["properties"])
    assert "errors" not in schemas["Problem"]["required"]
    assert schemas["JobIn"]["required"] == ["method", "inputs"]


def _operations(document: Json) -> Iterator[Json]:
    return (operation for item in document["paths"].values() for operation in item.values())
