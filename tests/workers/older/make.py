"""Makes the data of an older version of Impasto, for `test_older_versions.py`: a farm that was killed in the middle.

    git worktree add ../old COMMIT
    PYTHONPATH=../old .venv/bin/python tests/workers/older/make.py COMMIT

`abstraction` and `steady` have finished some tasks, `multistyle` and `patches` are planned, `analogy` is queued.
"""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

import av
import numpy as np

HERE = Path(__file__).parent
WIDTH, HEIGHT, FRAMES = 64, 48, 150
SEED = 5
RUNNING, QUEUED = ("abstraction", "steady"), ("multistyle", "patches", "analogy")


def clip(path: Path, flicker: int) -> Path:
    """A square that moves over a ramp, in two shots. `flicker`: of the brightness."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", rate=12, options={"crf": "20"})
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for index in range(FRAMES):
            frame = np.empty((HEIGHT, WIDTH, 3), np.uint8)
            frame[...] = np.linspace(20, 200, WIDTH, dtype=np.uint8)[:, None] + flicker * (index % 2)
            if index >= 2 * FRAMES // 3:
                frame[..., 1:] //= 4
            left = index % (WIDTH - 16)
            frame[12:28, left : left + 16] = (230, 180, 60)
            out.mux(video.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(video.encode(None))
    return path


def begin(home: Path, folder: Path) -> None:
    """Run in a process of the older version. Never returns: it kills itself."""
    try:
        from workers.farm import open_farm
    except ImportError:
        from workers.studio import open_farm
    import pipeline.methods
    from workers.contract.request import JobRequest
    from workers.settings import FarmSettings

    farm = open_farm(FarmSettings(home=home, workers=2, reserve_bytes=0))
    farm.start()
    add = farm.add_asset if hasattr(farm, "add_asset") else farm.assets.add
    submit = farm.submit if hasattr(farm, "submit") else farm.jobs.submit
    get = farm.job if hasattr(farm, "job") else farm.jobs.get
    running = [method for method in RUNNING if method in pipeline.methods.methods()]
    video, styled = (add(clip(folder / f"{n}.mp4", n), f"{n}.mp4").id for n in (0, 9))
    jobs = {}
    for method in (*running, *QUEUED):
        inputs = {"video": video, **({"styled": styled} if method == "steady" else {})}
        jobs[method] = submit(JobRequest(method, inputs, seed=SEED, name=method)).id
    while True:
        states = {method: get(job) for method, job in jobs.items()}
        if all(states[method].state == "succeeded" for method in running):
            raise SystemExit("too late")
        begun = [sum(step.counts["succeeded"] for step in states[method].steps) for method in running]
        if all(n >= 2 for n in begun) and all(any(states[m].counts.values()) for m in QUEUED):
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.01)


def main() -> None:
    commit = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder) / "home"
        ended = subprocess.run([sys.executable, __file__, commit, str(home)], check=False)
        assert ended.returncode == -signal.SIGKILL, ended
        saved = Path(folder) / "impasto.db"
        with sqlite3.connect(home / "impasto.db") as database:
            print(database.execute("SELECT method, state, step, planned FROM jobs").fetchall())
            print(database.execute("SELECT version_num FROM alembic_version").fetchall())
            database.execute(f"VACUUM INTO '{saved}'")
        for name in ("impasto.db-wal", "impasto.db-shm", "impasto.db"):
            (home / name).unlink(missing_ok=True)
        shutil.copy(saved, home / "impasto.db")
        with tarfile.open(HERE / f"{commit}.tar.xz", "w:xz") as out:
            for part in ("impasto.db", "blobs"):
                out.add(home / part, part)


if __name__ == "__main__":
    if len(sys.argv) == 2:
        main()
    else:
        begin(Path(sys.argv[2]), Path(sys.argv[2]).parent)
