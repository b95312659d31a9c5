"""What the peers' scripts share: campaigns read, frames guessed, results written. Metres and radians."""

import csv
import json
import time
import tomllib
from pathlib import Path

import numpy as np

POSITION = ("x_m", "y_m", "z_m")
QUATERNION = ("qw", "qx", "qy", "qz")


class Campaign:
    """A campaign file with its table, split into what is fitted and what is held out."""

    def __init__(self, path):
        self.path = Path(path)
        document = tomllib.loads(self.path.read_text())
        self.folder = self.path.parent
        self.robot = self.folder / document["robot"]
        self.noise = document.get("noise", {})
        with open(self.folder / document["table"], newline="") as table:
            self.rows = list(csv.DictReader(table))
        self.fitted = [row for row in self.rows if row["split"] == "fit"]
        self.heldout = [row for row in self.rows if row["split"] == "heldout"]


def numbers(rows, columns):
    """Columns of rows as an array; a column or a number that is missing counts as 0."""
    return np.array([[float(row.get(column) or 0.0) for column in columns] for row in rows])


def rotations(rows):
    """Rotation matrices of the measured orientations, or None."""
    if not rows or "qw" not in rows[0]:
        return None
    w, x, y, z = (quaternions := numbers(rows, QUATERNION)).T / np.linalg.norm(quaternions, axis=1)
    return np.stack([
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ], axis=-2)


def nearest_rotation(matrix):
    """The rotation that is nearest to a matrix."""
    u, _, v = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def frames(turned, at, measured, rounds=50):
    """Rotation and origin of the arm's base in the tracker's frame, and the target in the last link's frame, from
    positions alone: rotation and linear least squares in turn. Pose of the last link: `turned`, `at`."""
    offset = np.zeros(3)
    for _ in range(rounds):
        there = at + turned @ offset
        rotation = nearest_rotation((measured - measured.mean(0)).T @ (there - there.mean(0)))
        left = measured - at @ rotation.T
        rows = np.concatenate([rotation @ turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2).reshape(-1, 6)
        found = np.linalg.lstsq(rows, left.ravel(), rcond=None)[0]
        offset = found[:3]
    return rotation, found[3:], offset


def timed(work, runs):
    """The last result of `work`, and wall and processor seconds of each run."""
    seconds, processor = [], []
    for _ in range(runs):
        wall, used = time.perf_counter(), time.process_time()
        result = work()
        seconds.append(time.perf_counter() - wall)
        processor.append(time.process_time() - used)
    return result, {"seconds": seconds, "processor_seconds": processor}


def write(path, result):
    """A result for run.py."""
    Path(path).write_text(json.dumps(result))
