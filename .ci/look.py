"""What must be seen in the pictures that .ci/viewer takes: each place by the colours that belong there."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

FOLDER = Path(sys.argv[1])

# red, green, blue and how far off a pixel may be in each
BLUE_ROBOT = ((20, 55, 120), 30)
WHITE_ROBOT = ((190, 192, 195), 40)
YELLOW = ((200, 224, 32), 40)  # of the largest errors
GREEN = ((33, 150, 130), 35)  # of errors in the middle of the scale
FORCE = ((213, 94, 0), 30)
TORQUE = ((204, 121, 167), 30)
SKY = ((86, 180, 233), 30)
ORANGE = ((230, 159, 0), 30)
TEXT = ((170, 170, 170), 60)

# shares of the picture's width and height
CELL = (0.02, 0.08, 0.58, 0.95)
SCALE = (0.03, 0.22, 0.14, 0.72)
PLOTS = (0.61, 0.07, 0.99, 0.58)
WORDS = (0.61, 0.62, 0.99, 0.95)
FIRST_VIEW = (0.145, 0.065, 0.35, 0.25)
VIEWS = (0.145, 0.05, 0.78, 0.70)  # where a viewer left to itself has its own

# picture, place, what, colour, pixels at least
SEEN = [
    ("direct", FIRST_VIEW, "the robot", WHITE_ROBOT, 800),
    ("direct", VIEWS, "words", TEXT, 3000),
    *[
        (name, *rest)
        for name in ("campaign", "ladder", "angles", "errors")
        for rest in (
            (CELL, "the robot's blue parts", BLUE_ROBOT, 8000),
            (CELL, "the robot's white parts", WHITE_ROBOT, 8000),
            (CELL, "arrows of errors", GREEN, 3000),
            (CELL, "force", FORCE, 800),
            (CELL, "torque", TORQUE, 300),
            (SCALE, "the upper end of the colours", YELLOW, 500),
            (SCALE, "the middle of the colours", GREEN, 500),
            (WORDS, "words", TEXT, 3000),
        )
    ],
    ("campaign", PLOTS, "errors by angle", SKY, 1500),
    ("ladder", PLOTS, "fitted errors", SKY, 1500),
    ("angles", PLOTS, "errors by angle", SKY, 1500),
    ("errors", PLOTS, "errors of the nominal robot", SKY, 3000),
    ("errors", PLOTS, "errors of the next step", ORANGE, 3000),
    ("fit", CELL, "the robot's blue parts", BLUE_ROBOT, 8000),
    ("fit", PLOTS, "fitted errors", SKY, 1500),
    ("commands", CELL, "the robot's blue parts", BLUE_ROBOT, 8000),
    ("commands", WORDS, "words", TEXT, 3000),
    ("drill", CELL, "the robot's blue parts", BLUE_ROBOT, 30000),
    ("drill", CELL, "both wrists' forces", FORCE, 2000),
    ("drill", CELL, "torque", TORQUE, 300),
    ("drill", PLOTS, "thrust", SKY, 3000),
    ("drill", PLOTS, "lateral force", ORANGE, 3000),
    ("drill", WORDS, "words", TEXT, 3000),
]


def part(picture, place):
    height, width = picture.shape[:2]
    left, top, right, bottom = place
    return picture[int(top * height) : int(bottom * height), int(left * width) : int(right * width)]


def count(picture, colour):
    wanted, off = colour
    return int((np.abs(picture.astype(int) - wanted).max(axis=2) <= off).sum())


def main():
    pictures = {}
    for name in sorted({row[0] for row in SEEN}):
        path = FOLDER / f"{name}.png"
        picture = np.asarray(Image.open(path).convert("RGB"))
        if picture.shape != (1720, 2800, 3):
            sys.exit(f"{path}: found a picture of {picture.shape}")
        pictures[name] = picture
    missing = 0
    for name, place, what, colour, least in SEEN:
        found = count(part(pictures[name], place), colour)
        ok = found >= least
        missing += not ok
        print(f"{'seen   ' if ok else 'MISSING'} {name}: {what}, {found} pixels of at least {least}")
    if missing:
        sys.exit(f"{missing} of {len(SEEN)} are not to be seen; the pictures are in {FOLDER}")
    print(f"viewer: all {len(SEEN)} are to be seen")


main()
