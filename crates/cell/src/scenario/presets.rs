//! Stiffness presets for the eight-joint arms of the SDA5F (waist, S, L, E, U, R, B, T), N·m/rad.

use crate::setup::Setup;

/// Sized like the strain-wave gears that such joints carry (a guess from gear sizes 32 down to 14).
const STRAIN_WAVE: [f64; 8] = [6e4, 3.5e4, 3.5e4, 1.8e4, 1.8e4, 0.8e4, 0.8e4, 0.6e4];
/// Appl. Sci. 2019, 9, 65, Table 3 (R1), in units of 10^exponent N·m/rad. No power of ten agrees with all the
/// deflections of its Fig. 4 and 5, so the exponent is a parameter of the preset.
const TABLE_3: [f64; 8] = [0.06, 0.07, 0.45, 0.05, 0.10, 0.03, 0.21, 9.95];
/// The same, Table 4 (R2). Its waist differs from Table 3's though it is the same joint.
const TABLE_4: [f64; 8] = [0.02, 0.10, 0.23, 0.06, 0.20, 0.02, 0.15, 9.50];

/// Names accepted.
pub const NAMES: &str = "strain_wave, paper";

/// Stiffness by joint (index, N·m/rad): the joints of each target's arm from the base on. A joint that two
/// arms share takes the first arm's value. `paper` gives Table 3 to the first target and Table 4 to the second.
///
/// # Errors
/// A sentence, for an unknown name, a missing exponent, or an arm without eight joints.
pub fn stiffness(
    name: &str,
    exponent: Option<i32>,
    setup: &Setup,
) -> Result<Vec<(usize, f64)>, String> {
    let mut all: Vec<(usize, f64)> = Vec::new();
    for target in 0..setup.targets.len() {
        let values = match (name, exponent) {
            ("strain_wave", None) => STRAIN_WAVE,
            ("strain_wave", Some(_)) => {
                return Err("strain_wave takes no exponent".to_owned());
            }
            ("paper", Some(exponent)) => {
                let table = if target == 0 { TABLE_3 } else { TABLE_4 };
                table.map(|value| value * 10f64.powi(exponent))
            }
            ("paper", None) => {
                return Err(
                    "paper needs exponent = 4 (or 3, 5, 6): none of them agrees with all of the \
                            paper's own deflections"
                        .to_owned(),
                );
            }
            _ => return Err(format!("no preset is called \"{name}\"; known: {NAMES}")),
        };
        let chain = setup.robot.chain(setup.target_body(target));
        if chain.len() != values.len() {
            return Err(format!(
                "preset {name} is for arms of {} joints; target {} hangs on {}",
                values.len(),
                setup.targets[target].name,
                chain.len()
            ));
        }
        for (joint, value) in chain.into_iter().zip(values) {
            if !all.iter().any(|&(known, _)| known == joint) {
                all.push((joint, value));
            }
        }
    }
    Ok(all)
}
