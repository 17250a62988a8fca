"""A stand-in for ComfyUI, which no registry has: on the path of a process, it is what the node pack imports.

It has ComfyUI's contract with nodes: the loader (`nodes`), validation and execution of a graph (`execution`), progress
and interruption (`comfy`), and of torch what the pack uses, on NumPy. It differs in that it has no web page, server,
models, subgraphs or lists, and keeps results of the last run only. The same test runs in a real ComfyUI, too, if
IMPASTO_COMFYUI names one.
"""
