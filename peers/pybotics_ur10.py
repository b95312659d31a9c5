"""pybotics on the UR10 campaign, as its calibration notebook does it, with frames and the whole chain free.

usage: pybotics_ur10.py CAMPAIGN OUT.json [--coordinates]

pybotics compares distances of positions, so orientations are not used. A distance hides its direction, and least
squares creep; with --coordinates the residuals are x, y, z of pybotics' forward kinematics instead. Modified DH
parameters that the frames or a parallel axis can replace are held: link 0, `d` of links 1 and 2, `theta` and `d` of
the last. A tilt between parallel axes has no parameter there. pybotics has no way to find frames far away: it is
given the closed form.
"""

import sys
import xml.etree.ElementTree as xml

import numpy as np
from campaign import POSITION, Campaign, frames, numbers, timed, write
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from scipy.optimize import least_squares

MM = 1e3  # pybotics' own UR10 is in millimetres


def chain(path):
    """Joint names and modified DH rows (alpha, a, theta, d) of a URDF written as such a table, in mm and rad."""
    names, rows = [], []
    for joint in xml.parse(path).getroot().iter("joint"):
        origin = joint.find("origin")
        x, y, z = (MM * float(word) for word in origin.get("xyz").split())
        roll, pitch, yaw = (float(word) for word in origin.get("rpy").split())
        assert y == pitch == yaw == 0.0, f"{joint.get('name')}: not a row of modified DH"
        # an offset along the axis before is the d of the row before
        if rows:
            rows[-1][3] = z
        if joint.get("type") != "fixed":
            names.append(joint.get("name"))
            rows.append([roll, x, 0.0, 0.0])
    return names, np.array(rows)


def by_coordinate(vector, handler, angles, measured):
    """What a user writes who knows that `optimize_accuracy` creeps."""
    handler.apply_optimization_vector(vector)
    return (np.array([handler.robot.fk(q)[:3, 3] for q in angles]) - measured).ravel()


def main():
    campaign, out, coordinates = Campaign(sys.argv[1]), sys.argv[2], "--coordinates" in sys.argv
    names, nominal = chain(campaign.robot)
    angles, heldout = (numbers(rows, [f"{name}_rad" for name in names]) for rows in (campaign.fitted, campaign.heldout))
    measured = MM * numbers(campaign.fitted, POSITION)
    free = np.ones(nominal.shape, bool)
    free[0] = free[1:3, 3] = free[-1, 2:] = False

    def identify():
        robot = Robot.from_parameters(nominal.ravel())
        poses = np.array([robot.fk(q) for q in angles])
        rotation, origin, offset = frames(poses[:, :3, :3], poses[:, :3, 3], measured)
        robot.world_frame[:3, :3], robot.world_frame[:3, 3] = rotation, origin
        robot.tool.position = offset
        handler = OptimizationHandler(robot, free.ravel(), [True] * 3 + [False] * 3, True)
        start = handler.generate_optimization_vector()
        # the notebook's plain call; beside it the solver that MINPACK has for the well-behaved problem
        function, solver = (by_coordinate, {"method": "lm"}) if coordinates else (optimize_accuracy, {})
        found = least_squares(function, start, args=(handler, angles, measured), **solver)
        handler.apply_optimization_vector(found.x)
        return handler.robot, found

    (robot, found), seconds = timed(identify, 1)
    write(out, {
        **seconds,
        "parameters": len(found.x),
        "converged": bool(found.success),
        "predicted_m": [(robot.fk(q)[:3, 3] / MM).tolist() for q in heldout],
    })


main()
