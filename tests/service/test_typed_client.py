"""A client generated from the OpenAPI of the service: fields, a plan, its progress and its results.

It has models of pydantic, and a method per operation.
"""

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from datamodel_code_generator import InputFileType, PythonVersion, generate
from datamodel_code_generator.enums import DataModelType
from datamodel_code_generator.parser import LiteralType
from pydantic import ValidationError

from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.service.conftest import BOTH, SMALL, bearer, client_of
from tests.service.one_process import create_app

USED = """
from service_client import Client
from service_models import PlanJobRequest

def plan(client: Client) -> str:
    fields = client.list_fields().items
    job = client.ask_plan(PlanJobRequest(field=fields[0].name, tractors="1"))
    return client.watch_plan(job.id).status{wrong}
"""

HEAD = '''"""Generated from the OpenAPI of the service; one method per operation, named by its operationId."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

import service_models as models


class Refused(Exception):
    """An answer above 399: its status and the sentence of the service."""

    def __init__(self, status: int, error: Any) -> None:
        super().__init__(f"{status}: {error}")
        self.status, self.error = status, error


class Client:
    def __init__(self, http: Any, headers: dict[str, str]) -> None:
        self.http, self.headers = http, headers

    def _send(self, method: str, path: str, query: dict[str, Any], body: Any = None, **files: Any) -> Any:
        query = {name: value for name, value in query.items() if value is not None}
        sent = {} if body is None else {"json": body.model_dump(mode="json", exclude_unset=True, by_alias=True)}
        answer = self.http.request(method, path, params=query, headers=self.headers, **sent, **files)
        if answer.status_code > 399:
            raise Refused(answer.status_code, answer.json())
        return answer
'''
TYPES = {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}


def generate_client(api: dict[str, Any], folder: Path) -> ModuleType:
    """The module with the class Client, from an OpenAPI description."""
    models = folder / "service_models.py"
    generate(
        json.dumps(api), input_file_type=InputFileType.OpenAPI, output=models,
        output_model_type=DataModelType.PydanticV2BaseModel, target_python_version=PythonVersion.PY_311,
        use_standard_collections=True, use_annotated=True, use_union_operator=True, disable_timestamp=True,
        enum_field_as_literal=LiteralType.All, formatters=[],
    )  # fmt: skip
    written = [_write_method(path, *one) for path, operations in api["paths"].items() for one in operations.items()]
    (folder / "service_client.py").write_text(HEAD + "".join(written), encoding="utf-8")
    load_module("service_models", models)
    return load_module("service_client", folder / "service_client.py")


def load_module(name: str, path: Path) -> ModuleType:
    """A module from a file, also under its name for other modules."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _write_method(path: str, method: str, operation: dict[str, Any]) -> str:
    """The source of one operation; a file is uploaded as bytes, and an answer that is no model comes as bytes."""
    known = [one for one in operation.get("parameters", []) if one["in"] in ("path", "query")]
    given = [f"{one['name']}: {_name_type(one['schema'])}" for one in known if one["required"]]
    content = operation.get("requestBody", {}).get("content", {})
    model = _find_model(content.get("application/json", {}).get("schema", {}))
    given += [f"body: models.{model}"] if model else ["file: Any"] if content else []
    given += [f"{one['name']}: {_name_type(one['schema'])} | None = None" for one in known if not one["required"]]
    query = ", ".join(f'"{one["name"]}": {one["name"]}' for one in known if one["in"] == "query")
    sent = ", body" if model else ', files={"file": file}' if content else ""
    responses = operation["responses"]
    fine: dict[str, Any] = next((one for status, one in responses.items() if status.startswith("2")), {})
    answer = _find_model(fine.get("content", {}).get("application/json", {}).get("schema", {}))
    address = re.sub(r"{(\w+)}", r"{quote(str(\1), safe='')}", path)
    call = f'self._send("{method.upper()}", f"{address}", {{{query}}}{sent})'
    line = f"return models.{answer}.model_validate({call}.json())" if answer else f"return bytes({call}.content)"
    result = f"models.{answer}" if answer else "bytes"
    return f"\n    def {operation['operationId']}({', '.join(['self', *given])}) -> {result}:\n        {line}\n"


def _find_model(schema: dict[str, Any]) -> str:
    return str(schema.get("$ref", "")).rsplit("/", 1)[-1]


def _name_type(schema: dict[str, Any]) -> str:
    kinds = [schema, *schema.get("anyOf", [])]
    return next((TYPES[one["type"]] for one in kinds if one.get("type") in TYPES), "Any")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ModuleType, Any, Store, Path]]:
    """The generated module, a client of it on a service without workers, the store, and where the module is."""
    settings = ServiceSettings(data=tmp_path_factory.mktemp("data"), workers=0)
    app = create_app(settings, reads_inline=True)
    folder = tmp_path_factory.mktemp("client")
    module = generate_client(app.openapi(), folder)
    with client_of(app) as http:
        yield module, module.Client(http, bearer(app, BOTH)), app.state.store, folder


@pytest.mark.slow
def test_a_program_asks_for_a_plan_and_fetches_the_result(service: tuple[ModuleType, Any, Store, Path]) -> None:
    module, client, store, folder = service
    source = (folder / "service_client.py").read_text(encoding="utf-8")
    assert "def ask_plan(self, body: models.PlanJobRequest) -> models.JobInfo:" in source
    assert all(callable(getattr(client, name)) for name in ("list_jobs", "ask_day"))
    uploaded = client.upload_field(("north.geojson", SMALL, "application/geo+json"))
    assert uploaded.name in [one.name for one in client.list_fields().items]
    request = module.models.PlanJobRequest(
        field=uploaded.name, local=True, tractors="1", strategies="split-field", width=6.0
    )
    job = client.ask_plan(request)
    assert client.watch_plan(job.id).status == "queued"
    claimed = store.claim_job("w")
    store.keep_results(0, {"result.json": b"{}"})
    assert claimed is not None and store.finish_job(claimed.number, "w", {"result.json": b"{}"})
    done = client.watch_plan(job.id)
    assert done.status == "done" and done.results == ["result.json"]
    assert client.download_plan_result(job.id, "result.json") == b"{}"
    assert job.id in [one.id for one in client.list_plan_jobs().items]


def test_refusals_come_with_their_sentence(service: tuple[ModuleType, Any, Store, Path]) -> None:
    module, client, _, _ = service
    with pytest.raises(module.Refused, match="422") as refusal:
        client.ask_plan(module.models.PlanJobRequest(tractors="3-1"))
    assert refusal.value.error["parameter"] == "tractors"
    with pytest.raises(module.Refused, match="404"):
        client.watch_plan("../fields")
    with pytest.raises(ValidationError, match="widht"):
        module.models.PlanJobRequest(widht=3)


@pytest.mark.slow
def test_the_client_is_typed(service: tuple[ModuleType, Any, Store, Path]) -> None:
    pytest.importorskip("mypy", reason="types are checked with mypy")
    folder = service[-1]
    for name, wrong in (("used.py", ""), ("misused.py", ".colour")):
        (folder / name).write_text(USED.format(wrong=wrong), encoding="utf-8")
    words = ["-m", "mypy", "--strict", "--config-file=", "--cache-dir", str(folder / "types"), "used.py", "misused.py"]
    checked = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=240)
    errors = [line for line in checked.stdout.splitlines() if ": error:" in line]
    assert all(each.startswith("misused.py") for each in errors), errors
    assert any("has no attribute" in each for each in errors), errors
