"""Validation and execution of a graph with ComfyUI's rules: inputs by type and limits, lazy inputs, unchanged nodes."""

import nodes
from comfy import model_management


def _declared(node):
    types = nodes.NODE_CLASS_MAPPINGS[node["class_type"]].INPUT_TYPES()
    return types.get("required", {}), types.get("optional", {})


def _is_link(value):
    return isinstance(value, list)


def _faults(prompt, node):
    needed, optional = _declared(node)
    for name, declared in {**needed, **optional}.items():
        if name not in node["inputs"]:
            if name in needed:
                yield f"Required input is missing: {name}"
            continue
        value, kind = node["inputs"][name], declared[0]
        options = declared[1] if len(declared) > 1 else {}
        if _is_link(value):
            source = nodes.NODE_CLASS_MAPPINGS[prompt[value[0]]["class_type"]]
            if source.RETURN_TYPES[value[1]] != kind:
                yield f"Return type mismatch between linked nodes: {name}"
            yield from _faults(prompt, prompt[value[0]])
        elif isinstance(kind, list) and value not in kind:
            yield f"Value not in list: {name}: {value!r}"
        elif kind in ("INT", "FLOAT"):
            if value < options.get("min", value):
                yield f"Value smaller than min: {name}"
            if value > options.get("max", value):
                yield f"Value bigger than max: {name}"


def validate_prompt(prompt):
    """(valid, error, ids of valid output nodes, errors by node)."""
    classes = {node_id: nodes.NODE_CLASS_MAPPINGS.get(node["class_type"]) for node_id, node in prompt.items()}
    if missing := [node_id for node_id, cls in classes.items() if cls is None]:
        return False, {"details": f"node {prompt[missing[0]]['class_type']} does not exist"}, [], {}
    ends = [node_id for node_id, cls in classes.items() if getattr(cls, "OUTPUT_NODE", False)]
    faults = {k: list(_faults(prompt, prompt[k])) for k in ends}
    if good := [k for k in ends if not faults[k]]:
        return True, None, good, {}
    return False, {"message": "Prompt outputs failed validation"}, [], faults


class PromptExecutor:
    def __init__(self, server):
        self.server, self.success, self.results = server, True, {}

    def execute(self, prompt, prompt_id, extra_data, execute_outputs):
        """Execute what the outputs need and what changed since the last run; events go to the server."""
        nodes.interrupt_processing(False)
        keys = {node_id: self._key(prompt, node_id) for node_id in prompt}
        self.results = {key: value for key, value in self.results.items() if key in keys.values()}
        self.success = True
        for node_id in execute_outputs:
            if not self._run(prompt, keys, node_id, prompt_id):
                self.success = False
                return
        self._tell("execution_success", prompt_id)

    def _key(self, prompt, node_id):
        """What a node's result depends on: its class, values, IS_CHANGED, and the nodes that it is linked to."""
        node = prompt[node_id]
        cls = nodes.NODE_CLASS_MAPPINGS[node["class_type"]]
        constants = {k: v for k, v in node["inputs"].items() if not _is_link(v)}
        changed = cls.IS_CHANGED(**constants) if hasattr(cls, "IS_CHANGED") else None
        rows = [(k, (self._key(prompt, v[0]), v[1]) if _is_link(v) else repr(v)) for k, v in node["inputs"].items()]
        return node["class_type"], changed, tuple(sorted(rows, key=lambda row: row[0]))

    def _run(self, prompt, keys, node_id, prompt_id):
        if keys[node_id] in self.results:
            return True
        node = prompt[node_id]
        declared = {k: v for types in _declared(node) for k, v in types.items()}
        given = {name: node["inputs"][name] for name in node["inputs"] if name in declared}
        lazy = {name for name, value in given.items()
                if _is_link(value) and len(declared[name]) > 1 and declared[name][1].get("lazy")}  # fmt: skip
        values = {}
        try:
            unit = nodes.NODE_CLASS_MAPPINGS[node["class_type"]]()
            for name in sorted(given, key=list(given).index):
                if name not in lazy and not self._take(prompt, keys, given, name, values, prompt_id):
                    return False
            if hasattr(unit, "check_lazy_status"):
                for name in unit.check_lazy_status(**values, **dict.fromkeys(lazy)):
                    if not self._take(prompt, keys, given, name, values, prompt_id):
                        return False
            model_management.throw_exception_if_processing_interrupted()
            self._tell("executing", prompt_id, node=node_id)
            self.results[keys[node_id]] = getattr(unit, unit.FUNCTION)(**{**dict.fromkeys(lazy), **values})
        except model_management.InterruptProcessingException:
            self._tell("execution_interrupted", prompt_id, node_id=node_id)
            return False
        except Exception as error:
            self._tell("execution_error", prompt_id, node_id=node_id, exception_message=str(error))
            return False
        return True

    def _take(self, prompt, keys, given, name, values, prompt_id):
        value = given[name]
        if not _is_link(value):
            values[name] = value
            return True
        if not self._run(prompt, keys, value[0], prompt_id):
            return False
        values[name] = self.results[keys[value[0]]][value[1]]
        return True

    def _tell(self, event, prompt_id, **more):
        self.server.send_sync(event, {"prompt_id": prompt_id, **more}, self.server.client_id)
