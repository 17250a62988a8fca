"""Stylise a camera or a clip from a program: `python examples/live.py [clip.mp4]`, with `impasto serve` running."""

from __future__ import annotations

import sys

import cv2

from impasto import LiveClient


def main(source: str | int) -> None:
    camera = cv2.VideoCapture(source)
    size = int(camera.get(cv2.CAP_PROP_FRAME_WIDTH)), int(camera.get(cv2.CAP_PROP_FRAME_HEIGHT))
    with LiveClient("http://127.0.0.1:8420", size=size, fps=camera.get(cv2.CAP_PROP_FPS) or 30) as live:
        sent, shown = 0, 0
        while sent < 300:
            there, picture = camera.read()
            if not there:
                break
            live.send(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
            sent += 1
            for answer in live.answers(wait_s=1 / 30):  # at the pace of answers: nothing is dropped
                cv2.imwrite("newest.png", cv2.cvtColor(live.picture(answer), cv2.COLOR_RGB2BGR))
                shown += 1
                print(f"\r{shown} of {sent}, {answer.latency_us / 1000:.0f} ms in the service", end="")
    print(f"\n{live.stats['painted']} frames painted; the newest is newest.png")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else 0)
