//! The doctor: a gross disagreement of robot and readings, explained by one repair.
//!
//! No parameter of the robot is freed: the nominal robot and the frames must agree with the readings to a small share of
//! the positions' spread. Where they do not, every single repair is tried, and scored by the same fit of frames alone.

use super::finding::{Finding, Severity};
use super::repairs::{Repair, catalogue};
use super::stations;
use super::table::{FramesAlone, Table};
use crate::campaign::Campaign;
use rayon::prelude::*;

/// Readings that candidates are tried on, at most.
const MAX_TRIED: usize = 90;
/// Distinct postures below which frames alone agree with anything.
const MIN_POSTURES: usize = 6;
/// Rounds from each start of a candidate.
const QUICK: usize = 6;
/// Frames alone agree with an honest table to this share of its spread (and to this angle, rad).
const AGREES: f64 = 0.008;
/// Disagreement beyond this share is said even where no repair explains it.
const GROSS: f64 = 0.06;
/// A repair explains what falls to this share of it.
const EXPLAINS: f64 = 1.0 / 3.0;
/// Repairs this near to the best cannot be told from it.
const TIED: f64 = 1.3;

/// What the scores of repairs say.
#[derive(Debug, Clone, PartialEq)]
pub enum Judgement {
    /// Robot and readings agree.
    Agree,
    /// These repairs explain the disagreement equally well, the likely ones first.
    Explained(Vec<usize>),
    /// None explains it.
    Unexplained,
}

/// Judges the misfit of a table (share of the spread) and those after each repair.
pub fn judge(misfit: f64, repaired: &[f64]) -> Judgement {
    if misfit <= AGREES {
        return Judgement::Agree;
    }
    let best = repaired.iter().copied().fold(f64::INFINITY, f64::min);
    let threshold = best.max(AGREES / 8.0) * TIED;
    let explains = |score: f64| score <= EXPLAINS * misfit && score <= GROSS;
    let tied: Vec<usize> = (0..repaired.len())
        .filter(|&k| explains(repaired[k]) && repaired[k] <= threshold)
        .collect();
    match (tied.is_empty(), misfit > GROSS) {
        (false, _) => Judgement::Explained(tied),
        (true, true) => Judgement::Unexplained,
        (true, false) => Judgement::Agree,
    }
}

/// What the doctor found.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// Findings to be told.
    pub findings: Vec<Finding>,
    /// The fit of frames alone to the table as it is.
    pub frames: FramesAlone,
    /// Does the nominal robot agree with the readings?
    pub agrees: bool,
}

/// Looks at the readings with these indices; none if they are too few to say anything.
pub fn diagnose(campaign: &Campaign, rows: &[usize]) -> Option<Diagnosis> {
    let robot = &campaign.robot;
    let table = Table::of(campaign, rows);
    let mut postures: Vec<Vec<u64>> = table
        .joints
        .iter()
        .map(|q| q.iter().map(|q| q.to_bits()).collect())
        .collect();
    postures.sort_unstable();
    postures.dedup();
    if postures.len() < MIN_POSTURES {
        return None;
    }
    let some = strided(table.len());
    let own = FramesAlone::fit(robot, &table.select(&some), QUICK);
    let misfit = own.misfit();
    let mut found = Diagnosis {
        findings: Vec::new(),
        frames: own,
        agrees: true,
    };
    if misfit <= AGREES {
        return Some(found);
    }
    let repairs = catalogue(robot, &table);
    let scores: Vec<f64> = repairs
        .par_iter()
        .map(|repair| score(campaign, &table, &some, *repair))
        .collect();
    match judge(misfit, &scores) {
        Judgement::Agree => {}
        Judgement::Explained(tied) => {
            found.agrees = false;
            let tied: Vec<(Repair, f64)> = tied.iter().map(|&k| (repairs[k], scores[k])).collect();
            found
                .findings
                .push(explained(campaign, &table, &some, &found.frames, &tied));
        }
        Judgement::Unexplained => {
            found.agrees = false;
            let finding = match stations::blocks(robot, &table, 2.0 * AGREES) {
                Some(starts) => set_up_anew(campaign, rows, &starts, &found.frames),
                None if orientations_alone(&found.frames) => orientation_unexplained(&found.frames),
                None => unexplained(&found.frames, &repairs, &scores, campaign),
            };
            found.findings.push(finding);
        }
    }
    Some(found)
}

fn strided(count: usize) -> Vec<usize> {
    let stride = count.div_ceil(MAX_TRIED).max(1);
    (0..count).step_by(stride).collect()
}

/// What frames alone leave after a repair.
fn score(campaign: &Campaign, table: &Table, some: &[usize], repair: Repair) -> f64 {
    let repaired = repaired(campaign, table, some, repair);
    let misfit = FramesAlone::fit(&campaign.robot, &repaired, QUICK).misfit();
    if misfit.is_finite() {
        misfit
    } else {
        f64::INFINITY
    }
}

fn repaired(campaign: &Campaign, table: &Table, some: &[usize], repair: Repair) -> Table {
    if repair.needs_order() {
        let shifted = repair.apply(&campaign.robot, table);
        return shifted.select(&strided(shifted.len()));
    }
    repair.apply(&campaign.robot, &table.select(some))
}

/// Positions agree, orientations do not.
fn orientations_alone(frames: &FramesAlone) -> bool {
    frames.position_rms() <= AGREES * frames.spread
}

fn explained(
    campaign: &Campaign,
    table: &Table,
    some: &[usize],
    before: &FramesAlone,
    tied: &[(Repair, f64)],
) -> Finding {
    let (repair, _) = tied[0];
    let after = repaired(campaign, table, some, repair);
    let after = FramesAlone::fit(&campaign.robot, &after, QUICK);
    let same = tied[1..].iter().take(3);
    let same: Vec<String> = same.map(|(other, _)| other.what(campaign)).collect();
    let also = match same.is_empty() {
        true => String::new(),
        false => format!("; the same to these readings: {}", same.join(", or ")),
    };
    let kind = match repair {
        Repair::QuaternionOrder(..) | Repair::QuaternionInverse => "orientation_convention",
        _ => "one_repair",
    };
    Finding::new(kind, Severity::Error, repair.what(campaign))
        .because(format!(
            "the nominal robot and free frames leave {}, with this repaired {}{also}",
            left(before),
            left(&after)
        ))
        .remedy(repair.remedy(campaign))
}

fn set_up_anew(
    campaign: &Campaign,
    rows: &[usize],
    starts: &[usize],
    frames: &FramesAlone,
) -> Finding {
    let lines: Vec<usize> = starts[1..]
        .iter()
        .map(|&start| campaign.readings[rows[start]].line)
        .collect();
    let words: Vec<String> = lines.iter().map(usize::to_string).collect();
    Finding::new(
        "set_up_anew",
        Severity::Error,
        format!(
            "the tracker or the base was set up anew at line {}: from there on the readings need another frame",
            words.join(" and at line ")
        ),
    )
    .at(lines)
    .because(format!(
        "one frame for all leaves {}, a frame for each of {} blocks agrees with the nominal robot",
        left(frames),
        starts.len()
    ))
    .remedy("write a campaign for each set-up: the rows of one block, and frames of their own")
}

fn unexplained(
    frames: &FramesAlone,
    repairs: &[Repair],
    scores: &[f64],
    campaign: &Campaign,
) -> Finding {
    let best = (0..scores.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
    let best = best.map_or_else(String::new, |k| {
        let share = 100.0 * scores[k] / frames.misfit();
        format!(
            "; the best of {} single repairs ({}) leaves {share:.0} % of it",
            repairs.len(),
            repairs[k].what(campaign)
        )
    });
    Finding::new(
        "robot_and_readings",
        Severity::Error,
        "the nominal robot does not agree with the readings, and no single repair of the table explains it",
    )
    .because(format!(
        "the nominal robot and free frames leave {}, of positions that spread over {}{best}",
        left(frames),
        length(frames.spread)
    ))
    .remedy(
        "compare one posture of the robot with the robot file: units, zeros and signs of the joints, the link of the \
         target, several set-ups of the tracker in one table",
    )
}

fn orientation_unexplained(frames: &FramesAlone) -> Finding {
    Finding::new(
        "orientation_convention",
        Severity::Error,
        "the positions agree with the nominal robot, the orientations do not: they are in another convention",
    )
    .because(format!("the nominal robot and free frames leave {}", left(frames)))
    .remedy(
        "in the campaign file, under [columns], say the convention: orientation = { columns = […], convention = \"…\" } \
         (kuka_abc, abb_quaternion, fanuc_wpr, yaskawa_rxryrz, staubli, ur_rotvec, rpy, euler:<axes>, quaternion:xyzw), \
         or leave the orientation's columns out",
    )
}

fn left(frames: &FramesAlone) -> String {
    let position = length(frames.position_rms());
    match frames.orientation_rms() {
        Some(angle) => format!("{position} and {} rms", turn(angle)),
        None => format!("{position} rms"),
    }
}

/// A length with three digits and a unit that suits it.
pub fn length(metres: f64) -> String {
    match metres.abs() {
        m if m >= 10.0 => format!("{metres:.1} m"),
        m if m >= 1e-3 => format!("{:.1} mm", 1e3 * metres),
        m if m >= 1e-4 => format!("{:.3} mm", 1e3 * metres),
        _ => format!("{:.2} µm", 1e6 * metres),
    }
}

fn turn(angle: f64) -> String {
    match angle {
        a if a >= 0.02 => format!("{:.1}°", a.to_degrees()),
        a => format!("{:.2} mrad", 1e3 * a),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repair_must_explain_a_gross_disagreement() {
        let explained = |k: &[usize]| Judgement::Explained(k.to_vec());
        for (misfit, repaired, judgement) in [
            // honest tables are left alone, whatever a repair could gain
            (0.0079, vec![0.0], Judgement::Agree),
            (0.0081, vec![0.002], explained(&[0])),
            // better, but not by enough
            (0.03, vec![0.0101], Judgement::Agree),
            (0.03, vec![0.0099], explained(&[0])),
            // ties, in the order of the catalogue
            (0.5, vec![0.4, 0.0025, 0.002, 0.0027], explained(&[1, 2])),
            // below an eighth of what is honest all are alike
            (0.5, vec![1e-9, 0.0012, 0.0014], explained(&[0, 1])),
            // what is left after the repair is still gross
            (0.9, vec![0.061], Judgement::Unexplained),
            (0.9, vec![0.059], explained(&[0])),
            (0.061, vec![0.05], Judgement::Unexplained),
            (0.059, vec![0.05], Judgement::Agree),
            (0.5, vec![f64::INFINITY], Judgement::Unexplained),
        ] {
            assert_eq!(judge(misfit, &repaired), judgement, "{misfit} {repaired:?}");
        }
    }

    #[test]
    fn lengths_are_said_in_units_that_suit_them() {
        for (metres, words) in [
            (12.3456, "12.3 m"),
            (0.0037, "3.7 mm"),
            (0.00025, "0.250 mm"),
            (1.234e-5, "12.34 µm"),
        ] {
            assert_eq!(length(metres), words);
        }
    }
}
