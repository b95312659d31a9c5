//! The robot as viewers want it: a URDF.

use crate::campaign::RobotFile;
use crate::robot::{Robot, to_urdf};

/// The robot file itself if it is a URDF, else a URDF with the same frames and shapes.
pub(super) fn urdf(robot: &Robot, file: &RobotFile) -> String {
    if file.name.to_lowercase().ends_with(".toml") {
        to_urdf(robot)
    } else {
        file.text.clone()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::messages::{Time, TransformStamped};
    use super::super::transforms::{links, moving};
    use super::*;
    use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
    use std::collections::BTreeMap;

    fn frames(robot: &Robot, joints: &[f64]) -> BTreeMap<String, Isometry3<f64>> {
        let stamp = Time { sec: 0, nanosec: 0 };
        let mut poses = BTreeMap::from([(robot.bodies[0].name.clone(), Isometry3::identity())]);
        let mut add = |t: &TransformStamped<'_>| {
            let (x, q) = (&t.translation, &t.rotation);
            let pose = Isometry3::from_parts(
                Translation3::new(x.x, x.y, x.z),
                UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z)),
            );
            let pose = poses[t.header.frame_id.as_ref()] * pose;
            poses.insert(t.child_frame_id.to_string(), pose);
        };
        moving(robot, joints, stamp, |_| true)
            .iter()
            .for_each(&mut add);
        links(robot, "", stamp).iter().for_each(&mut add);
        poses
    }

    #[test]
    fn a_dh_table_becomes_a_urdf_with_the_same_frames() {
        for convention in ["standard", "modified"] {
            let table = format!(
                "name = \"a & b\"\nconvention = \"{convention}\"\n[base]\nxyz_m = [0.1, 0.2, 0.3]\n\
                 [[joint]]\nname = \"j1\"\nalpha_deg = 90\na_mm = 150\nd_mm = 243\ntheta_deg = 30\n\
                 [[joint]]\nname = \"j2\"\nalpha_deg = -40\na_mm = 70\nd_mm = -43\n\
                 [[joint]]\nname = \"j3\"\nkind = \"prismatic\"\nalpha_deg = 20\na_mm = 30\n\
                 [tool]\nxyz_m = [0.0, 0.1, 0.2]\nrpy_deg = [10, 20, 30]\n"
            );
            let robot = Robot::parse("arm.toml", &table, None).unwrap();
            let copy = Robot::parse("arm.urdf", &to_urdf(&robot), None).unwrap();
            let joints = [0.3, -0.7, 0.2];
            let (wanted, got) = (frames(&robot, &joints), frames(&copy, &joints));
            for (name, pose) in wanted {
                let gap = pose.inverse() * got[&name];
                assert!(
                    gap.translation.vector.norm() + gap.rotation.angle() < 1e-12,
                    "{convention}: {name} is off by {gap}"
                );
            }
        }
    }
}
