"""ComfyUI's progress bar, and the function that its server hooks in."""

_hook = None


def set_progress_bar_global_hook(hook):
    global _hook
    _hook = hook


class ProgressBar:
    def __init__(self, total):
        self.total = total

    def update_absolute(self, value, total=None, preview=None):
        self.total = total or self.total
        if _hook:
            _hook(min(value, self.total), self.total, preview)
