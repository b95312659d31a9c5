//! What several modules of tests share; plant and model of one truth.

#[path = "../../misfit-core/tests/common.rs"]
mod robots;

use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Noise, Reading};
use misfit_core::model::{Model, Prediction, Workspace};
use misfit_plant::instruments::{Draws, Seen, read};
use misfit_plant::{Command, Load, Plant, PlantSpec, State};
use nalgebra::{Isometry3, Vector3};
pub use robots::*;

/// The same truth twice: as a model with its parameters, and as a plant.
pub struct Twins {
    pub model: Model,
    pub p: Vec<f64>,
    pub spec: PlantSpec,
    pub plant: Plant,
    workspace: Workspace,
}

impl Twins {
    pub fn new(setup: &Setup, parts: &[Part]) -> Self {
        let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
        let model = Model::new(setup.clone(), &effects);
        let p = parts.iter().flat_map(|part| part.values.clone()).collect();
        let links = setup.targets.iter().map(|target| target.link).collect();
        let mut spec = PlantSpec::new(&setup.robot, links, setup.gravity);
        for part in parts {
            part.effect.install(&part.values, setup, &mut spec).unwrap();
        }
        Self {
            workspace: Workspace::new(setup),
            plant: Plant::build(&spec).unwrap(),
            model,
            p,
            spec,
        }
    }

    pub fn predict(&mut self, reading: &Reading) -> Prediction {
        let prediction = self.workspace.predict(&self.model, &self.p, reading);
        assert!(prediction.settled);
        prediction
    }

    /// What the plant's instruments say without noise, and its state.
    pub fn measure(&mut self, reading: &Reading) -> (Seen, State) {
        let joints = reading.joints.len();
        let load = reading.payload.map(|payload| Load {
            target: reading.target,
            mass: payload.mass,
            com: payload.com,
            pull: Vector3::zeros(),
            moment: Vector3::zeros(),
        });
        let command = Command {
            joints: reading.joints.clone(),
            approach: reading
                .approach
                .clone()
                .unwrap_or_else(|| vec![0.0; joints]),
            loads: load.into_iter().collect(),
            time: reading
                .time
                .map_or(0.0, |time| time - self.model.setup.time_zero),
            temperature: reading
                .temperature
                .map_or(0.0, |t| t - self.model.setup.temperature_zero),
        };
        let state = self.plant.state(&command).unwrap();
        let draws = Draws::new(joints, &mut random(0));
        let seen = read(
            &self.spec,
            &command,
            &state,
            reading.target,
            &Noise::default(),
            &draws,
        );
        (seen, state)
    }

    /// How far prediction and measurement are apart: m, rad.
    pub fn gap(&mut self, reading: &Reading) -> (f64, f64) {
        let predicted = pose_of(&self.predict(reading));
        apart(&predicted, &pose_seen(&self.measure(reading).0))
    }

    /// Measures a list of readings into a campaign that knows no frame and no noise.
    pub fn campaign(&mut self, mut readings: Vec<Reading>) -> Campaign {
        for reading in &mut readings {
            let (seen, _) = self.measure(reading);
            reading.position = seen.position;
            reading.orientation = Some(seen.orientation);
            reading.wrench = reading.wrench.map(|_| seen.wrench);
        }
        campaign(&self.model.setup, readings)
    }
}

/// tracker_from_target as measured.
pub fn pose_seen(seen: &Seen) -> Isometry3<f64> {
    Isometry3::from_parts(seen.position.into(), seen.orientation)
}
