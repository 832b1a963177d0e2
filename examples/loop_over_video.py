"""Find a marker in every frame of a video, near where it was in the frame before, and print its pose.

python examples/loop_over_video.py marker.json camera.yaml video.avi annotated.avi
"""

import argparse

import cv2

import markergen as mg


def main(marker: str, camera: str, video: str, annotated: str | None) -> None:
    """Print a line for every frame; write the annotated video if a file for it is named."""
    detector = mg.Detector(marker, camera)
    source, target = cv2.VideoCapture(video), cv2.VideoWriter()
    if not source.isOpened():
        raise SystemExit(f"cannot read {video}")
    if annotated:
        size = (int(source.get(cv2.CAP_PROP_FRAME_WIDTH)), int(source.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        target.open(annotated, cv2.VideoWriter.fourcc(*"MJPG"), source.get(cv2.CAP_PROP_FPS), size)
    number, results, (ok, frame) = 0, list[mg.Found](), source.read()
    while ok:
        for finding in (results := detector(frame, near=results)):
            if finding.rvec is not None and finding.tvec is not None:
                print(f"frame {number}: rvec {finding.rvec.ravel()} tvec {finding.tvec.ravel()} m")
            else:
                print(f"frame {number}: {finding.reason}")
            finding.draw(frame)
        target.write(frame)
        number, (ok, frame) = number + 1, source.read()
    target.release()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Find a marker in every frame of a video.")
    for name in ("marker", "camera", "video"):
        parser.add_argument(name)
    parser.add_argument("annotated", nargs="?", help="an .avi file")
    main(**vars(parser.parse_args()))
