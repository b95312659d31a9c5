//! Which effects together: the set with the most evidence in which each one is sure beside the others.
//!
//! All on one linearisation: taking an effect in is a step of linear algebra, so that many sets are tried. A set is
//! refitted and tested before it is believed.

use super::ALARM;
use super::families::{Family, FamilyScore};
use super::score::{Against, Information};
use rayon::prelude::*;

/// Sets that are followed further at each size.
const BEAM: usize = 6;

/// A set of families.
#[derive(Debug, Clone)]
pub struct Set {
    /// Their indices, in the order in which they were taken.
    pub members: Vec<usize>,
    /// Log evidence of all together, nats.
    pub log_evidence: f64,
    /// What is known of all columns beside them.
    information: Information,
}

/// The best set of at most `most` of the families named in `tried`; empty if none is sure.
pub fn search(
    families: &[Family],
    tried: &[usize],
    information: &Information,
    against: &Against,
    most: usize,
) -> Set {
    let start = Set {
        members: Vec::new(),
        log_evidence: 0.0,
        information: information.clone(),
    };
    let mut best = start.clone();
    let mut beam = vec![start];
    for _ in 0..most {
        let mut next: Vec<(Vec<usize>, f64, usize, FamilyScore)> = Vec::new();
        for (parent, set) in beam.iter().enumerate() {
            let is_in = |&index: &usize| {
                let same = |&member: &usize| families[member].is_form_of(&families[index]);
                set.members.iter().any(same)
            };
            let scored = |&index: &usize| {
                let score = families[index].score(&set.information, against);
                score.is_sure(ALARM, tried.len()).then_some((index, score))
            };
            let others = tried.par_iter().filter(|index| !is_in(index));
            let sure: Vec<(usize, FamilyScore)> = others.filter_map(scored).collect();
            for (index, score) in sure {
                let mut members = set.members.clone();
                members.push(index);
                let total = set.log_evidence + score.log_evidence;
                let same = |other: &&mut (Vec<usize>, f64, usize, FamilyScore)| {
                    members.iter().all(|m| other.0.contains(m))
                };
                match next.iter_mut().find(same) {
                    Some(other) if other.1 >= total => {}
                    Some(other) => *other = (members, total, parent, score),
                    None => next.push((members, total, parent, score)),
                }
            }
        }
        next.sort_by(|a, b| b.1.total_cmp(&a.1));
        let minimal =
            |members: &[usize]| is_minimal(families, tried, members, information, against);
        let sets = next.into_iter().filter(|(members, ..)| minimal(members));
        let sets = sets.take(BEAM).map(|(members, total, parent, score)| {
            let last = &families[members[members.len() - 1]];
            Set {
                log_evidence: total,
                information: beam[parent].information.given(&last.columns, score.scale),
                members,
            }
        });
        beam = sets.collect();
        let Some(first) = beam.first() else { break };
        if first.log_evidence > best.log_evidence {
            best = first.clone();
        }
    }
    best
}

/// Is every member sure beside the others?
fn is_minimal(
    families: &[Family],
    tried: &[usize],
    members: &[usize],
    information: &Information,
    against: &Against,
) -> bool {
    members.len() < 2
        || members.iter().all(|&member| {
            let others = beside(families, members, member, information, against);
            families[member]
                .score(&others, against)
                .is_sure(ALARM, tried.len())
        })
}

/// What is known beside all members but one.
pub fn beside(
    families: &[Family],
    members: &[usize],
    without: usize,
    information: &Information,
    against: &Against,
) -> Information {
    let mut information = information.clone();
    for &other in members.iter().filter(|&&other| other != without) {
        let scale = families[other].score(&information, against).scale;
        information = information.given(&families[other].columns, scale);
    }
    information
}
