//! An effect of one's own in Rust: measured in the plant, missed by the default model, added, identified.
//!
//! `cargo run --release --example own_effect`. A law that is one formula needs no Rust: see
//! `misfit effects show expression`. This is the way for what takes more: parameters by joint, options, springs.

use anyhow::{Context, ensure};
use misfit_arm::dual_quaternion::Scalar;
use misfit_campaign::setup::Setup;
use misfit_cell::scenario::{Scenario, Truth, simulate::simulate};
use misfit_core::effects::{Effect, EffectList, Parameter, Place, Stage};
use misfit_core::fit::{Options, fit};
use misfit_core::model_file;
use misfit_core::posture::Posture;
use misfit_truth::{PlantSpec, SpecError};
use std::path::Path;
use std::sync::Arc;

/// A hose along the arm: bent by two neighbouring joints at once, it turns the second.
#[derive(Debug)]
struct Hose;

impl Effect for Hose {
    const ID: &'static str = "hose";
    const STAGE: Stage = Stage::Rigid;

    /// One for each pair of neighbours that a reading can depend on, named after the joint that is turned.
    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let turned = setup.observed.iter().skip(1);
        turned
            .map(|&joint| {
                Parameter::new(&setup.robot.joints[joint].name, "rad", 1e-4).at(Place::Joint(joint))
            })
            .collect()
    }

    /// The model's side, generic over the scalar: derivatives come by dual numbers.
    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (pair, &stiffness) in posture.setup.observed.windows(2).zip(p) {
            let bend = posture.q(pair[0]).sin() * posture.q(pair[1]).sin();
            posture.move_joint(pair[1], stiffness * bend);
        }
    }

    /// The plant's side: MuJoCo's springs come to rest where the hose lets them.
    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let (pairs, p) = (setup.observed.clone(), p.to_vec());
        plant.command_laws.push(Arc::new(move |command, angles| {
            for (pair, stiffness) in pairs.windows(2).zip(&p) {
                let [before, turned] = [pair[0], pair[1]].map(|joint| command.joints[joint]);
                // the product of the sines
                angles[pair[1]] +=
                    stiffness * 0.5 * ((before - turned).cos() - (before + turned).cos());
            }
        }));
        Ok(())
    }
}

fn main() -> anyhow::Result<()> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/hidden.toml");
    let mut scenario = Scenario::load(&file)?;
    scenario.name = "hose".to_owned();

    // the hidden truth: the hose in the place of the scenario's gear error
    let hose = misfit_core::effects::own(Hose);
    let size = |name: &str| match name {
        "r1_e" => 6e-4,
        _ => 0.0,
    };
    let parameters = hose.parameters(&scenario.setup).into_iter();
    let values = parameters.map(|parameter| {
        let value = size(&parameter.name);
        (parameter.name, value)
    });
    scenario
        .truth
        .retain(|truth| truth.effect.id() != "transmission_error");
    scenario.truth.push(Truth {
        effect: hose.clone(),
        values: values.collect(),
    });

    let campaign = simulate(&scenario, || {})?;
    let options = Options {
        cross_validate: true,
    };
    let default = model_file::model(&campaign, &EffectList::DEFAULT, None)?;
    let before = fit(&campaign, &default, &options, |_| {})?;
    let after = fit(&campaign, &default.with(&hose), &options, |_| {})?;

    println!(
        "{} readings of {}",
        campaign.readings.len(),
        campaign.robot.name
    );
    for (model, fit) in [("default model", &before), ("with hose", &after)] {
        let heldout = fit.heldout.context("poses enough to cross-validate")?;
        println!(
            "{model:<14} fitted {:.4} mm rms, cross-validated {:.4} mm, {:.2} × noise",
            fit.fit.position_rms_m * 1e3,
            heldout.position_rms_m * 1e3,
            fit.fit.whitened_rms
        );
    }
    let index = after
        .index("hose", "r1_e")
        .context("a parameter by joint")?;
    let (value, std) = (after.values[index], after.std[index].context("estimated")?);
    let half = std * after.quantile();
    let truth = size("r1_e");
    println!("hose.r1_e      {value:.3e} ± {half:.1e} rad; the plant has {truth:.3e}");

    ensure!(after.converged, "the fit did not converge");
    ensure!(
        after.fit.whitened_rms < 1.1 && before.fit.whitened_rms > 1.5 * after.fit.whitened_rms,
        "the error did not fall to the noise"
    );
    ensure!((value - truth).abs() < 5.0 * std, "the truth was not found");
    Ok(())
}
