//! What is drawn, in numbers: one place for the tracker, errors of every step, and scales that stay.

use misfit_campaign::recording::{Holds, Recording, Step};
use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Frame};
use misfit_core::fit::start;
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeSet;

/// Postures that a campaign needs, at the least, before the tracker is placed by them.
const FEWEST_POSTURES: usize = 6;
/// Postures nearer than this in every joint are one, rad (m).
const SAME_POSTURE: f64 = 0.02;

/// A recording with what is needed to draw it.
#[derive(Debug)]
pub struct Scene<'a> {
    /// As read.
    pub recording: &'a Recording,
    /// Tracker in the base frame, the same for all steps, so that points stay where they are; `None`: not known.
    pub base_from_tracker: Option<Isometry3<f64>>,
    /// The nominal robot with its frames first; empty where nothing was measured or the tracker's place is not known.
    pub steps: Vec<Drawn>,
    /// Nominal, by reading and link, base frame.
    pub nominal: Vec<Vec<Isometry3<f64>>>,
    /// s, one a reading.
    pub times: Vec<f64>,
    /// Of residual arrows: 1, 2 or 5 times a power of ten.
    pub magnification: f64,
    /// Of the fitted robot's deviation from the nominal one.
    pub robot_magnification: f64,
    /// Position error at the upper end of the colours, m: that of the first step.
    pub worst: f64,
    /// Middle of all that is drawn, m.
    pub centre: Point3<f64>,
    /// Half of its diagonal, m.
    pub radius: f64,
    /// Where the eye looks, m: the middle, or the wrists while a process pulls at them.
    pub focus: Point3<f64>,
    /// How far the eye sees about it, m.
    pub reach: f64,
}

/// One step: where its model puts the targets.
#[derive(Debug)]
pub struct Drawn {
    /// `nominal`, the effect added, or `fitted`.
    pub added: String,
    /// Last part of its entities' names: its number first.
    pub name: String,
    /// rms, m: fitted and held out.
    pub rms: (f64, Option<f64>),
    /// Predicted target poses in the base frame, by the scene's tracker.
    pub predicted: Vec<Isometry3<f64>>,
    /// Measured less predicted, m, base frame.
    pub errors: Vec<Vector3<f64>>,
    /// Angle between measured and predicted orientation, rad.
    pub turns: Vec<Option<f64>>,
}

impl<'a> Scene<'a> {
    /// Prepares a recording.
    pub fn of(recording: &'a Recording) -> Self {
        let campaign = &recording.campaign;
        let nominal: Vec<Vec<Isometry3<f64>>> = campaign
            .readings
            .iter()
            .map(|reading| links(campaign, &reading.joints))
            .collect();
        let (base_from_tracker, made) = steps(recording, &nominal);
        let steps: Vec<Drawn> = match base_from_tracker {
            Some(place) if !commands(recording) => {
                let steps = made.iter().enumerate();
                steps
                    .map(|(index, step)| Drawn::of(campaign, index, step, &place))
                    .collect()
            }
            _ => Vec::new(),
        };
        let (centre, radius) = extent(campaign, &nominal, base_from_tracker.as_ref());
        let first = steps.first().map(|step| step.sizes()).unwrap_or_default();
        let worst = round_up(quantile(first.clone(), 0.99).max(1e-9));
        let magnification = round(0.12 * radius / quantile(first, 0.9).max(1e-9));
        let deviations = recording.results.iter().flat_map(|results| {
            let pairs = results.links.iter().zip(&nominal);
            pairs.flat_map(|(fitted, nominal)| {
                let links = fitted.iter().zip(nominal);
                links.map(|(f, n)| (f.translation.vector - n.translation.vector).norm())
            })
        });
        let robot_magnification =
            round(0.08 * radius / quantile(deviations.collect(), 0.98).max(1e-9));
        Self {
            recording,
            base_from_tracker,
            steps,
            nominal,
            times: times(campaign),
            magnification,
            robot_magnification,
            worst,
            centre,
            radius,
            focus: centre,
            reach: radius,
        }
        .looking_at_wrists()
    }

    /// Is this a process at the wrists, as drilling is: loads, but no errors to show?
    pub fn process(&self) -> bool {
        let mut readings = self.recording.campaign.readings.iter();
        self.steps.is_empty() && !self.commands() && readings.any(|r| r.wrench.is_some())
    }

    fn looking_at_wrists(mut self) -> Self {
        if self.process() {
            let wrists = self.targets().filter_map(|(_, _, link)| {
                let links = self.nominal.first()?;
                Some(links[link].translation.vector)
            });
            let wrists: Vec<Vector3<f64>> = wrists.collect();
            let middle = wrists.iter().sum::<Vector3<f64>>() / wrists.len().max(1) as f64;
            self.focus = Point3::from(middle);
            self.reach = 0.75 * self.radius;
        }
        self
    }

    /// Measured target poses in the base frame; an orientation that was not measured is the last step's.
    pub fn measured(&self) -> Vec<Isometry3<f64>> {
        let (Some(place), Some(last)) = (self.base_from_tracker, self.steps.last()) else {
            return Vec::new();
        };
        let readings = self.recording.campaign.readings.iter();
        readings
            .zip(&last.predicted)
            .map(|(reading, predicted)| {
                let at = place * Point3::from(reading.position);
                let turn = reading.orientation.map(|turn| place.rotation * turn);
                Isometry3::from_parts(at.coords.into(), turn.unwrap_or(predicted.rotation))
            })
            .collect()
    }

    /// Were these wanted and not measured?
    pub fn commands(&self) -> bool {
        commands(self.recording)
    }

    /// Links that a target is fixed to, with the target's index and name.
    pub fn targets(&self) -> impl Iterator<Item = (usize, &str, usize)> {
        let targets = self.recording.campaign.targets.iter().enumerate();
        targets.map(|(index, target)| (index, target.name.as_str(), target.link))
    }
}

impl Drawn {
    fn of(campaign: &Campaign, index: usize, step: &Step, place: &Isometry3<f64>) -> Self {
        let pairs = || campaign.readings.iter().zip(&step.predicted);
        Self {
            added: step.added.clone(),
            name: format!("{index}_{}", step.added),
            rms: (step.fitted_rms_m, step.heldout_rms_m),
            predicted: step.predicted.iter().map(|pose| place * pose).collect(),
            errors: pairs()
                .map(|(reading, pose)| {
                    place.rotation * (reading.position - pose.translation.vector)
                })
                .collect(),
            turns: pairs()
                .map(|(reading, pose)| Some(reading.orientation?.angle_to(&pose.rotation)))
                .collect(),
        }
    }

    /// Norms of the errors, m.
    pub fn sizes(&self) -> Vec<f64> {
        self.errors.iter().map(Vector3::norm).collect()
    }
}

fn commands(recording: &Recording) -> bool {
    recording.holds == Holds::Commands
}

/// Nominal links in the base frame.
fn links(campaign: &Campaign, joints: &[f64]) -> Vec<Isometry3<f64>> {
    let bodies = campaign.robot.body_poses(joints);
    let links = campaign.robot.links.iter();
    links
        .map(|link| bodies[link.body] * link.body_from_link)
        .collect()
}

/// The recording's steps and the last one's tracker; without results the nominal robot alone, with frames in closed form.
fn steps(
    recording: &Recording,
    nominal: &[Vec<Isometry3<f64>>],
) -> (Option<Isometry3<f64>>, Vec<Step>) {
    let campaign = &recording.campaign;
    if let Some(results) = &recording.results
        && let Some(last) = results.steps.last()
    {
        return (Some(last.base_from_tracker), results.steps.clone());
    }
    if let Frame::Known(place) = campaign.base_from_tracker
        && commands(recording)
    {
        return (Some(place), Vec::new());
    }
    if commands(recording) || postures(campaign) < FEWEST_POSTURES {
        return (None, Vec::new());
    }
    let all: Vec<_> = campaign.readings.iter().collect();
    let found = start::frames(campaign, &Setup::of(campaign), &all);
    let tracker_from_base = found.base_from_tracker.inverse();
    let predicted: Vec<Isometry3<f64>> = campaign
        .readings
        .iter()
        .zip(nominal)
        .map(|(reading, links)| {
            let link = campaign.targets[reading.target].link;
            tracker_from_base * links[link] * found.link_from_target[reading.target]
        })
        .collect();
    let squares = campaign.readings.iter().zip(&predicted);
    let squares: f64 = squares
        .map(|(reading, pose)| (reading.position - pose.translation.vector).norm_squared())
        .sum();
    let step = Step {
        added: "nominal".to_owned(),
        fitted_rms_m: (squares / predicted.len().max(1) as f64).sqrt(),
        heldout_rms_m: None,
        base_from_tracker: found.base_from_tracker,
        predicted,
    };
    (Some(found.base_from_tracker), vec![step])
}

/// How many postures the readings were taken in, counted no further than needed.
fn postures(campaign: &Campaign) -> usize {
    let mut seen = BTreeSet::new();
    for reading in &campaign.readings {
        let cells = reading.joints.iter();
        let cell: Vec<i64> = cells.map(|q| (q / SAME_POSTURE).round() as i64).collect();
        seen.insert(cell);
        if seen.len() > 100 {
            break;
        }
    }
    seen.len()
}

/// Measured times if every reading has one, else a second a reading, as the recording itself has them.
fn times(campaign: &Campaign) -> Vec<f64> {
    let measured: Option<Vec<f64>> = campaign
        .readings
        .iter()
        .map(|reading| reading.time.filter(|time| time.is_finite()))
        .collect();
    measured.unwrap_or_else(|| (0..campaign.readings.len()).map(|i| i as f64).collect())
}

/// Middle and half diagonal of the box around links and measured points.
fn extent(
    campaign: &Campaign,
    nominal: &[Vec<Isometry3<f64>>],
    place: Option<&Isometry3<f64>>,
) -> (Point3<f64>, f64) {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = -low;
    let mut add = |point: &Vector3<f64>| {
        if point.iter().all(|x| x.is_finite()) {
            low = low.inf(point);
            high = high.sup(point);
        }
    };
    for pose in nominal.iter().flatten() {
        add(&pose.translation.vector);
    }
    for reading in campaign.readings.iter() {
        if let Some(place) = place {
            add(&(place * Point3::from(reading.position)).coords);
        }
    }
    if low.x > high.x {
        return (Point3::origin(), 1.0);
    }
    let radius = ((high - low).norm() / 2.0).max(0.05);
    (Point3::from((low + high) / 2.0), radius)
}

/// Value below which this share of the numbers lies; 0 of none.
pub(crate) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    let index = (share * values.len().saturating_sub(1) as f64).round() as usize;
    values.get(index).copied().unwrap_or_default()
}

/// 1, 2 or 5 times a power of ten, not above the value.
pub(crate) fn round(value: f64) -> f64 {
    let fits = |step: &f64| *step <= value * (1.0 + 1e-9);
    near(value).into_iter().rfind(fits).unwrap_or(1.0)
}

/// 1, 2 or 5 times a power of ten, not below the value.
pub(crate) fn round_up(value: f64) -> f64 {
    let fits = |step: &f64| *step >= value * (1.0 - 1e-9);
    near(value).into_iter().find(fits).unwrap_or(1.0)
}

/// Round numbers about a value, rising; none about one that is not above zero.
fn near(value: f64) -> Vec<f64> {
    if !(value > 0.0 && value.is_finite()) {
        return Vec::new();
    }
    let power = 10f64.powf(value.log10().floor());
    [0.5, 1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .to_vec()
}

#[cfg(test)]
mod tests {
    use super::{round, round_up};

    #[test]
    fn scales_are_round() {
        for (value, below, above) in [
            (3.4, 2.0, 5.0),
            (5.0, 5.0, 5.0),
            (0.012, 0.01, 0.02),
            (77.0, 50.0, 100.0),
        ] {
            assert!((round(value) - below).abs() < 1e-9 * below, "{value}");
            assert!((round_up(value) - above).abs() < 1e-9 * above, "{value}");
        }
        assert_eq!(round(f64::NAN), 1.0);
    }
}
