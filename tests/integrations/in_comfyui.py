"""Runs in ComfyUI's Python, or over the stand-in: loads the node pack, executes graphs, prints what happened as JSON.

python in_comfyui.py PACK FOLDER      with ComfyUI or the stand-in in PYTHONPATH, and IMPASTO_SERVER
"""
# ruff: noqa: E402 (ComfyUI reads its options while it is imported)

import json
import sys

import comfy.options

pack, folder = sys.argv[1:]
sys.argv[1:] = ["--cpu"]
comfy.options.enable_args_parsing()

import comfy.utils
import execution
import nodes
import numpy as np
import torch


class Square:
    """Frames of a square that moves, or one picture of it."""

    RETURN_TYPES, FUNCTION = ("IMAGE",), "make"

    @classmethod
    def INPUT_TYPES(cls):
        return {"required": {"frames": ("INT", {"default": 6}), "side": ("INT", {"default": 96}),
                             "level": ("FLOAT", {"default": 0.9})}}  # fmt: skip

    def make(self, frames, side, level):
        made = np.full((frames, side * 2 // 3, side, 3), (0.1, 0.3, 0.5), np.float32)
        for k, frame in enumerate(made):
            frame[20:44, 10 + 4 * k : 34 + 4 * k] = (level, 0.7, 0.2)
        return (torch.from_numpy(made),)


class Switch:
    """One of two branches; the other is not executed."""

    RETURN_TYPES, FUNCTION = ("IMAGE",), "choose"

    @classmethod
    def INPUT_TYPES(cls):
        branch = ("IMAGE", {"lazy": True})
        return {"required": {"first": ("BOOLEAN", {}), "a": branch, "b": branch}}

    def check_lazy_status(self, first, a=None, b=None):
        return ["a" if first else "b"]

    def choose(self, first, a=None, b=None):
        return (a if first else b,)


class Keep:
    """The end of a graph: keeps what arrives."""

    RETURN_TYPES, FUNCTION, OUTPUT_NODE = (), "keep", True
    kept = {}

    @classmethod
    def INPUT_TYPES(cls):
        return {"required": {"images": ("IMAGE", {}), "name": ("STRING", {})},
                "optional": {"mask": ("MASK", {}), "report": ("STRING", {"forceInput": True})}}  # fmt: skip

    def keep(self, images, name, mask=None, report=""):
        self.kept[name] = report
        masked = {} if mask is None else {"mask": mask.cpu().numpy()}
        np.savez(f"{folder}/{name}.npz", images=images.cpu().numpy(), **masked)
        return ()


class Server:
    """Messages of an executor to its web page."""

    client_id, last_node_id, last_prompt_id = "test", None, None

    def __init__(self):
        self.events = []

    def send_sync(self, event, data, sid=None):
        self.events.append((event, data))


server, executor, progress = Server(), None, []
assert nodes.load_custom_node(pack)
nodes.NODE_CLASS_MAPPINGS.update(Square=Square, Switch=Switch, Keep=Keep)
comfy.utils.set_progress_bar_global_hook(lambda value, total, preview=None: progress.append(value / total))
executor = execution.PromptExecutor(server)


def run(prompt):
    """Execute a graph: which nodes ran, and how it ended."""
    server.events.clear()
    progress.clear()
    valid, _, ends, faults = execution.validate_prompt(prompt)
    if not valid:
        return {"refused": json.dumps(faults)}
    executor.execute(prompt, "prompt", {"client_id": "test"}, ends)
    ran = [data["node"] for event, data in server.events if event == "executing" and data["node"]]
    faults = [data.get("exception_message", event) for event, data in server.events
              if event in ("execution_error", "execution_interrupted")]  # fmt: skip
    return {"ran": ran, "fault": (faults or [""])[0].strip(), "progress": [*progress]}


def node(kind, **inputs):
    return {"class_type": kind, "inputs": inputs}


def graph(name, seed=0, **more):
    given = {"video": ["1", 0], "frames_per_second": 24.0, "painting_seed": seed, **more}
    method = given.pop("method", "abstraction")
    return {
        "1": node("Square", frames=6, side=96, level=0.9), "2": node(f"Impasto_{method}", **given),
        "3": node("Keep", images=["2", 0], mask=["2", 1], report=["2", 2], name=name),
    }  # fmt: skip


said = {"nodes": sorted(name for name in nodes.NODE_CLASS_MAPPINGS if name.startswith("Impasto_"))}
said["inputs"] = {name: nodes.NODE_CLASS_MAPPINGS[name].INPUT_TYPES() for name in said["nodes"]}
said["first"] = run(graph("first", lines="off", palette="#203040, #e0d0c0"))
said["again"] = run(graph("first", lines="off", palette="#203040, #e0d0c0"))
said["seed"] = run(graph("first", seed=1, lines="off", palette="#203040, #e0d0c0"))
said["value"] = run(graph("value", lines="dashed"))
said["limit"] = run(graph("limit", vividness=1000.0))
style = {"4": node("Square", frames=1, side=96, level=0.2), "5": node("Square", frames=2, side=96, level=0.3)}
keys = {"style_output": ["4", 0], "keyframes": ["5", 0], "keyframes_frames": "0, 1", "method": "analogy"}
said["keys"] = run({**style, **graph("keys", guide_weight=1.5, **keys)})
said["numbers"] = run({**style, **graph("numbers", **{**keys, "keyframes_frames": "0"})})
lazy = graph("lazy", seed=2)
lazy["6"] = node("Switch", first=False, a=["2", 0], b=["1", 0])
lazy["3"] = node("Keep", images=["6", 0], name="lazy")
said["lazy"] = run(lazy)
long = graph("long", seed=3)
long["1"] = node("Square", frames=48, side=384, level=0.9)
comfy.utils.set_progress_bar_global_hook(lambda value, total, preview=None: nodes.interrupt_processing(value > 10))
said["interrupted"] = run(long)
said["reports"] = Keep.kept
print("RESULT " + json.dumps(said))
