//! Robots of every kind: what the plant has comes back, whatever the axes are like.

use crate::common::file;
use misfit_campaign::Campaign;
use misfit_cell::scenario::{Scenario, simulate::simulate};
use misfit_core::effects::EffectList;
use misfit_core::fit::{self, Options, Status};
use misfit_core::model_file;
use std::fs;

/// A robot of `models/kinds`: its target's link, a load in kg, and compliances in rad/(N·m) or m/N by joint.
struct Kind {
    name: &'static str,
    link: &'static str,
    mass: f64,
    springs: &'static [(&'static str, f64)],
}

const KINDS: [Kind; 9] = [
    Kind {
        name: "offset_wrist",
        link: "flange",
        mass: 5.0,
        springs: &[
            ("j1", 9e-7),
            ("j2", 9e-7),
            ("j3", 2e-6),
            ("j4", 5e-6),
            ("j5", 5e-6),
            ("j6", 5e-6),
        ],
    },
    Kind {
        name: "spherical_wrist",
        link: "flange",
        mass: 10.0,
        springs: &[
            ("j1", 3e-7),
            ("j2", 3e-7),
            ("j3", 4e-7),
            ("j4", 2e-6),
            ("j5", 3e-6),
            ("j6", 4e-6),
        ],
    },
    Kind {
        name: "seven_axis",
        link: "flange",
        mass: 5.0,
        springs: &[
            ("j1", 2e-6),
            ("j2", 2e-6),
            ("j3", 3e-6),
            ("j4", 3e-6),
            ("j5", 3e-6),
            ("j6", 7e-6),
            ("j7", 7e-6),
        ],
    },
    Kind {
        name: "scara",
        link: "flange",
        mass: 5.0,
        springs: &[("j1", 2e-6), ("j2", 5e-6), ("j3", 3e-7), ("j4", 3e-5)],
    },
    Kind {
        name: "gantry",
        link: "flange",
        mass: 20.0,
        springs: &[
            ("x", 2e-7),
            ("y", 3e-7),
            ("z", 3e-7),
            ("c", 3e-6),
            ("b", 3e-6),
            ("a", 5e-6),
        ],
    },
    Kind {
        name: "rail_arm",
        link: "flange",
        mass: 5.0,
        springs: &[
            ("rail", 1e-7),
            ("j1", 5e-7),
            ("j2", 5e-7),
            ("j3", 1e-6),
            ("j4", 5e-6),
            ("j5", 6e-6),
            ("j6", 1e-5),
        ],
    },
    Kind {
        name: "palletiser",
        link: "flange",
        mass: 100.0,
        springs: &[
            ("j1", 4e-8),
            ("j2", 4e-8),
            ("j3", 5e-8),
            ("j4", 2e-7),
            ("j5", 5e-7),
        ],
    },
    Kind {
        name: "servo_arm",
        link: "flange",
        mass: 0.1,
        springs: &[
            ("base_yaw", 1e-3),
            ("shoulder", 2e-3),
            ("elbow", 3e-3),
            ("wrist_pitch", 3e-3),
            ("wrist_roll", 5e-3),
        ],
    },
    Kind {
        name: "torso_arms",
        link: "left_flange",
        mass: 3.0,
        springs: &[
            ("waist", 5e-7),
            ("left_s1", 2e-6),
            ("left_s2", 2e-6),
            ("left_e1", 4e-6),
            ("left_w1", 8e-6),
            ("left_w2", 8e-6),
            ("left_w3", 1e-5),
        ],
    },
];

fn measured(kind: &Kind) -> Campaign {
    let robot = file(&format!("models/kinds/{}.urdf", kind.name));
    let springs = kind.springs.iter();
    let springs: Vec<String> = springs
        .map(|(joint, c)| format!("{joint} = {c:e}"))
        .collect();
    let text = format!(
        "robot = {robot:?}\nseed = 3\n[[target]]\nname = \"t\"\nlink = \"{}\"\n\
         [noise]\nposition_m = 15e-6\norientation_rad = 60e-6\njoint_rad = 1e-5\n\
         [[truth]]\nkind = \"joint_compliance\"\nvalues = {{ {} }}\n\
         [[truth]]\nkind = \"geometry\"\nrandom = 0.3\n\
         [design]\nposes = 30\nheldout_poses = 6\ndirections = 2\nrepeats = 2\n\
         loads = [{{}}, {{ mass_kg = {} }}]\n",
        kind.link,
        springs.join(", "),
        kind.mass
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    fs::write(&path, text).unwrap();
    simulate(&Scenario::load(&path).unwrap(), || {}).unwrap()
}

#[test]
fn springs_of_robots_of_every_kind_come_back() {
    let options = Options {
        cross_validate: false,
    };
    let mut inside = Vec::new();
    for kind in &KINDS {
        let campaign = measured(kind);
        let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
        let found = fit::fit(&campaign, &model, &options, |_| {}).unwrap();
        assert!(found.converged, "{}", kind.name);
        // poses that were not fitted are predicted to the noise
        let heldout = found.heldout.unwrap().whitened_rms / found.noise.factor.sqrt();
        assert!(heldout < 1.2, "{}: {heldout}", kind.name);
        let mut seen = 0;
        for (joint, truth) in kind.springs {
            let index = found.index("joint_compliance", joint).unwrap();
            if found.status[index] == Status::Estimated {
                let std = found.std[index].unwrap();
                inside.push((found.values[index] - truth).abs() <= found.quantile() * std);
                // and never far off
                let off = (found.values[index] - truth).abs() / std;
                assert!(
                    off < 4.5,
                    "{}: {joint}: {off} standard deviations",
                    kind.name
                );
                seen += 1;
            }
        }
        assert!(seen > 0, "{}: no spring was seen", kind.name);
    }
    // of 95 % intervals: with 30 of them fewer than 25 have the truth in once in a hundred times
    let hits = inside.iter().filter(|hit| **hit).count();
    assert!(
        inside.len() >= 30 && hits * 100 >= inside.len() * 84,
        "{hits} of {}",
        inside.len()
    );
}
