"""FIGAROH on the UR10 campaign, as its own UR10 example does it.

usage: figaroh_ur10.py CAMPAIGN OUT.json   positions alone where the table has no orientations, else whole poses

The example's class and weights; frames unknown, so they are estimated. What it fits FIGAROH finds itself, by a QR
decomposition of its regressor. Its Levenberg-Marquardt (SciPy, MINPACK) differentiates by differences.
"""

import csv
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml
from campaign import POSITION, Campaign, numbers, rotations, timed, write
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.tools.robot import Robot


class UR10Calibration(BaseCalibration):
    """That of figaroh-examples, examples/ur10/utils/ur10_tools.py."""

    def cost_function(self, var):
        estimated = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        residuals = self._compute_logmap_residuals(self.PEE_measured, estimated)
        return self.apply_measurement_weighting(residuals, pos_weight=1.0, orient_weight=0.5)


def table(path, rows, joints):
    """Rows in the columns that FIGAROH reads."""
    turned = rotations(rows)
    position = numbers(rows, POSITION)
    angles = numbers(rows, [f"{joint}_rad" for joint in joints])
    with open(path, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["x1", "y1", "z1"] + (["phix1", "phiy1", "phiz1"] if turned is not None else []) + joints)
        for k in range(len(rows)):
            rpy = [] if turned is None else list(pin.rpy.matrixToRpy(turned[k]))
            writer.writerow([*position[k], *rpy, *angles[k]])


def calibration(campaign, folder):
    """A calibration with its data loaded."""
    robot = Robot(str(campaign.robot), package_dirs=str(campaign.folder))
    joints = list(robot.model.names)[1:]
    table(folder / "fitted.csv", campaign.fitted, joints)
    poses = rotations(campaign.fitted) is not None
    config = folder / "calibration.yaml"
    config.write_text(yaml.safe_dump({"robot": {"name": "ur10"}, "tasks": {"calibration": {
        "enabled": True,
        "parameters": {"calibration_level": "full_params", "outlier_threshold": 0.02},
        "kinematics": {"base_frame": "universe", "tool_frame": "flange"},
        "measurements": {
            "markers": [{"name": "target", "measurable_dof": [True] * 3 + [poses] * 3}],
            "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6},
        },
        "data": {"source_file": str(folder / "fitted.csv")},
    }}}))
    found = UR10Calibration(robot, str(config))
    found.calib_config["known_baseframe"] = False
    found.calib_config["known_tipframe"] = False
    found.load_data_set()
    return found


def main():
    campaign, out = Campaign(sys.argv[1]), Path(sys.argv[2])
    found = calibration(campaign, out.parent)
    _, selection = timed(found.create_param_list, 1)
    (result, excluded), seconds = timed(found.solve_optimisation, 1)
    joints = list(found.model.names)[1:]
    angles = numbers(campaign.heldout, [f"{joint}_rad" for joint in joints])
    config = dict(found.calib_config, NbSample=len(angles))
    predicted = calc_updated_fkm(found.model, found.data, result.x, angles, config)
    write(out, {
        **seconds,
        "selection_seconds": selection["seconds"],
        "parameters": len(result.x),
        "converged": bool(result.success) and not excluded,
        "predicted_m": np.reshape(predicted, (-1, len(angles)))[:3].T.tolist(),
    })


main()
