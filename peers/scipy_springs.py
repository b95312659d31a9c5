"""SciPy's least squares on the springs campaign, with the forward model that one writes for it in NumPy.

usage: scipy_springs.py CAMPAIGN OUT.json

The same problem as misfit's: two frames (12) and a compliance of each joint but the first, whose axis is vertical, so
that no weight turns it (misfit finds that itself); the loaded posture q + c tau(q) as a fixed
point, weights of the links from the URDF; residuals over their known noise. All readings at once in NumPy.
"""

import sys
import xml.etree.ElementTree as xml

import numpy as np
from campaign import POSITION, Campaign, frames, numbers, rotations, timed, write
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

GRAVITY = np.array([0.0, 0.0, -9.81])


class Arm:
    """A serial arm of a URDF: constant transforms, axes, and what each joint carries itself."""

    def __init__(self, path):
        robot = xml.parse(path).getroot()
        bodies = {}
        for link in robot.iter("link"):
            inertial = link.find("inertial")
            if inertial is not None:
                bodies[link.get("name")] = float(inertial.find("mass").get("value")), vector(inertial.find("origin"))
        self.names, self.turns, self.offsets, self.axes, self.bodies = [], [], [], [], []
        for joint in robot.iter("joint"):
            origin = joint.find("origin")
            turn = Rotation.from_euler("xyz", vector(origin, "rpy")).as_matrix()
            if joint.get("type") == "fixed":
                self.end = turn, vector(origin)
                continue
            self.names.append(joint.get("name"))
            self.turns.append(turn)
            self.offsets.append(vector(origin))
            self.axes.append(vector(joint.find("axis")))
            self.bodies.append(bodies[joint.find("child").get("link")])

    def place(self, angles, payload):
        """Rotation and origin of the last link for many postures, and the torques of weights about all joints."""
        turned = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
        at = np.zeros((len(angles), 3))
        origins, axes, centres = [], [], []
        for k, axis in enumerate(self.axes):
            at = at + turned @ self.offsets[k]
            turned = turned @ self.turns[k]
            axes.append(turned @ axis)
            origins.append(at)
            turned = turned @ about(axis, angles[:, k])
            centres.append(at + turned @ self.bodies[k][1])
        turned, at = turned @ self.end[0], at + turned @ self.end[1]
        mass = np.array([mass for mass, _ in self.bodies])[:, None]
        hung = at + np.einsum("nij,nj->ni", turned, payload[:, 1:])
        torques = np.empty_like(angles)
        carried, moment = payload[:, :1], payload[:, :1] * hung
        for k in reversed(range(len(self.axes))):
            carried = carried + mass[k]
            moment = moment + mass[k] * centres[k]
            torques[:, k] = np.einsum("ni,ni->n", axes[k], np.cross(moment - carried * origins[k], GRAVITY))
        return turned, at, torques

    def loaded(self, angles, payload, compliance):
        """The last link in the loaded posture."""
        bent = angles
        for _ in range(50):
            turned, at, torques = self.place(bent, payload)
            further = angles + compliance * torques
            if np.abs(further - bent).max() < 1e-12:
                break
            bent = further
        return turned, at


def vector(element, name="xyz"):
    """Three numbers of an attribute; zeros without it."""
    text = None if element is None else element.get(name)
    return np.zeros(3) if text is None else np.array([float(word) for word in text.split()])


def about(axis, angles):
    """Rotations by many angles about an axis."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + sin * cross + (1.0 - cos) * (cross @ cross)


def main():
    campaign, out = Campaign(sys.argv[1]), sys.argv[2]
    arm = Arm(campaign.robot)

    def columns(rows):
        load = numbers(rows, ("payload_kg", "payload_x_m", "payload_y_m", "payload_z_m"))
        return numbers(rows, [f"{name}_rad" for name in arm.names]), load

    angles, payload = columns(campaign.fitted)
    position, turned = numbers(campaign.fitted, POSITION), rotations(campaign.fitted)
    sizes = campaign.noise["position_m"], campaign.noise["orientation_rad"]

    def predict(values, angles, payload):
        # rotation vectors are small about the start
        base = base_start @ Rotation.from_rotvec(values[3:6]).as_matrix()
        tip = tip_start @ Rotation.from_rotvec(values[9:12]).as_matrix()
        link, at = arm.loaded(angles, payload, np.concatenate([[0.0], 1e-6 * values[12:]]))
        return base @ link @ tip, (at + link @ values[6:9]) @ base.T + values[:3]

    def residuals(values):
        orientation, there = predict(values, angles, payload)
        turn = Rotation.from_matrix(turned @ orientation.swapaxes(1, 2)).as_rotvec()
        return np.concatenate([((position - there) / sizes[0]).ravel(), (turn / sizes[1]).ravel()])

    def identify():
        nonlocal base_start, tip_start
        link, at, _ = arm.place(angles, payload)
        base_start, origin, offset = frames(link, at, position)
        tip_start = Rotation.from_matrix((base_start @ link).swapaxes(1, 2) @ turned).mean().as_matrix()
        start = np.concatenate([origin, np.zeros(3), offset, np.zeros(3), np.zeros(len(arm.names) - 1)])
        return least_squares(residuals, start, x_scale="jac", method="lm")

    base_start = tip_start = np.eye(3)
    found, seconds = timed(identify, 1)
    write(out, {
        **seconds,
        "parameters": len(found.x),
        "converged": bool(found.success),
        "values": {f"joint_compliance.{name}": 1e-6 * value for name, value in zip(arm.names[1:], found.x[12:])},
        "predicted_m": predict(found.x, *columns(campaign.heldout))[1].tolist(),
    })


main()
