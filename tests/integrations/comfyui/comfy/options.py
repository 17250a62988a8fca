"""ComfyUI's switch to read options from the command; the stand-in has none."""


def enable_args_parsing():
    pass
