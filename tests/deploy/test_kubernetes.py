"""deploy/kubernetes is checked against Kubernetes' own schemas, also the pods within KubeRay's resources."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from service.settings import Settings

HERE = Path(__file__).resolve().parents[2] / "deploy" / "kubernetes"
VERSION = "1.33"


@cache
def documents() -> list[dict[str, Any]]:
    """All documents that the base lists, in order; do not change them."""
    listed = yaml.safe_load((HERE / "base" / "kustomization.yaml").read_text())["resources"]
    return [row for name in listed for row in yaml.safe_load_all((HERE / "base" / name).read_text())]


def of(kind: str, name: str = "") -> dict[str, Any]:
    return next(row for row in documents() if row["kind"] == kind and name in ("", row["metadata"]["name"]))


def cluster() -> dict[str, Any]:
    """The RayCluster with the group of the GPU overlay."""
    found = copy.deepcopy(of("RayCluster"))
    (patch,) = yaml.safe_load((HERE / "gpu" / "workers.yaml").read_text())
    assert (patch["op"], patch["path"]) == ("add", "/spec/workerGroupSpecs/-")
    found["spec"]["workerGroupSpecs"].append(patch["value"])
    return found


def templates() -> dict[str, dict[str, Any]]:
    """All pod templates of the manifests by name."""
    spec = cluster()["spec"]
    groups = {group["groupName"]: group["template"] for group in spec["workerGroupSpecs"]}
    return {"service": of("Deployment")["spec"]["template"], "head": spec["headGroupSpec"]["template"], **groups}


def test_every_manifest_is_listed_in_the_kustomization() -> None:
    for folder in ("base", "gpu"):
        listed = yaml.safe_load((HERE / folder / "kustomization.yaml").read_text())
        named = {*listed["resources"], *(patch["path"] for patch in listed.get("patches", ()))}
        files = {path.name for path in (HERE / folder).glob("*.yaml")} - {"kustomization.yaml"}
        assert files <= named
        assert all((HERE / folder / name).exists() for name in named)


@pytest.mark.parametrize("document", documents(), ids=lambda row: f"{row['kind']}-{row['metadata']['name']}")
def test_manifests_match_the_kubernetes_schema(document: dict[str, Any]) -> None:
    if document["kind"] != "RayCluster":  # an operator's own kind: its pods are checked below
        kubernetes_validate.validate(document, VERSION, strict=True)


@pytest.mark.parametrize("name", templates())
def test_pod_templates_match_the_kubernetes_schema(name: str) -> None:
    template = templates()[name]
    pod = {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": "x", **template["metadata"]},
        "spec": template["spec"],
    }
    kubernetes_validate.validate(pod, VERSION, strict=True)
    wrong = copy.deepcopy(pod)
    wrong["spec"]["containers"][0]["imgae"] = "x"
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, VERSION, strict=True)


@pytest.mark.parametrize("name", templates())
def test_pods_satisfy_the_restricted_standard(name: str) -> None:
    spec = templates()[name]["spec"]
    assert spec["securityContext"]["runAsNonRoot"] and spec["securityContext"]["runAsUser"] == 10001
    assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    mounted = {volume["name"] for volume in spec["volumes"]}
    for container in spec["containers"]:
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
        assert container["resources"]["limits"]["memory"]
        assert container["livenessProbe"] and container["readinessProbe"]
        assert {mount["name"] for mount in container["volumeMounts"]} == mounted
    assert not {"hostNetwork", "hostPID", "hostIPC"} & spec.keys()


def test_ray_autoscaling_and_token_authentication_are_enabled() -> None:
    spec = cluster()["spec"]
    assert spec["enableInTreeAutoscaling"] and spec["authOptions"]["mode"] == "token"
    assert spec["headGroupSpec"]["rayStartParams"]["num-cpus"] == "0"
    for group in spec["workerGroupSpecs"]:
        assert 0 <= group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]
        (container,) = group["template"]["spec"]["containers"]
        assert container["resources"]["requests"]["cpu"] == container["resources"]["limits"]["cpu"]
    gpu = spec["workerGroupSpecs"][1]["template"]["spec"]["containers"][0]["resources"]["limits"]
    assert gpu["nvidia.com/gpu"] == "1"
    assert all(isinstance(value, str) for value in spec["headGroupSpec"]["rayStartParams"].values())


def test_services_outlive_a_drained_node() -> None:
    deployment, budget = of("Deployment"), of("PodDisruptionBudget")
    assert deployment["spec"]["replicas"] >= 2 > budget["spec"]["minAvailable"] >= 1
    chosen = deployment["spec"]["selector"]["matchLabels"]
    assert budget["spec"]["selector"]["matchLabels"] == chosen == of("Service")["spec"]["selector"]
    assert chosen.items() <= deployment["spec"]["template"]["metadata"]["labels"].items()


def test_secrets_are_referenced_and_settings_exist() -> None:
    assert not [row for row in documents() if row["kind"] == "Secret"]
    settings = of("ConfigMap")["data"]
    assert {name.removeprefix("IMPASTO_").lower() for name in settings} <= set(Settings.model_fields)
    assert not [name for name in settings if "SECRET" in name or "KEY" in name or "DATABASE" in name]
    given = {name.removeprefix("IMPASTO_").lower(): value for name, value in settings.items()}
    assert Settings.model_validate(given).workers == 8
    (container,) = of("Deployment")["spec"]["template"]["spec"]["containers"]
    assert {"secretRef": {"name": "impasto-secrets"}} in container["envFrom"]
    host = settings["IMPASTO_RAY_ADDRESS"].partition(":")[0]
    assert host == f"{cluster()['metadata']['name']}-head-svc.{of('Namespace')['metadata']['name']}.svc.cluster.local"


def test_the_gpu_overlay_gives_each_task_a_share_of_a_gpu() -> None:
    listed = yaml.safe_load((HERE / "gpu" / "kustomization.yaml").read_text())["patches"]
    targets = {patch["path"]: patch["target"] for patch in listed}
    assert targets["settings.yaml"] == {
        "version": "v1",
        "kind": "ConfigMap",
        "name": of("ConfigMap")["metadata"]["name"],
    }
    (patch,) = yaml.safe_load((HERE / "gpu" / "settings.yaml").read_text())
    name = patch["path"].rpartition("/")[2].removeprefix("IMPASTO_").lower()
    settings = Settings.model_validate({name: patch["value"]})
    group = next(row for row in cluster()["spec"]["workerGroupSpecs"] if row["groupName"] == "gpu")
    (container,) = group["template"]["spec"]["containers"]
    assert 0 < settings.task_gpus <= int(container["resources"]["limits"]["nvidia.com/gpu"])


def test_a_worker_has_memory_for_one_task_per_cpu() -> None:
    """Ray's memory resource is the memory of the container minus the object store."""
    for group in cluster()["spec"]["workerGroupSpecs"]:
        (container,) = group["template"]["spec"]["containers"]
        limits = container["resources"]["limits"]
        left = (int(limits["memory"].removesuffix("Gi")) << 30) - int(group["rayStartParams"]["object-store-memory"])
        assert 0.8 * left >= int(limits["cpu"]) * Settings().task_memory_bytes


def test_network_access_is_denied_unless_allowed() -> None:
    policies = [row for row in documents() if row["kind"] == "NetworkPolicy"]
    closed = [row for row in policies if row["spec"]["podSelector"] == {} and "Ingress" in row["spec"]["policyTypes"]]
    assert len(closed) == 1 and "ingress" not in closed[0]["spec"]
    among = next(row for row in policies if row["metadata"]["name"] == "ray-among-itself")["spec"]
    (who,) = among["podSelector"]["matchExpressions"]
    assert among["ingress"] == [{"from": [{"podSelector": {"matchExpressions": [who]}}]}]
    names = {template["metadata"]["labels"]["app.kubernetes.io/name"] for template in templates().values()}
    assert set(who["values"]) == names


def test_image_names_are_defined_once() -> None:
    listed = {row["name"] for row in yaml.safe_load((HERE / "base" / "kustomization.yaml").read_text())["images"]}
    used = {c["image"].partition(":")[0] for template in templates().values() for c in template["spec"]["containers"]}
    assert used == listed
