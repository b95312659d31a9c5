//! What a campaign can say at all, before it is asked: its design, and how many effects it could see and tell apart.

use super::VISIBLE;
use super::families::{Family, FamilyScore};
use super::score::Information;
use crate::campaign::{Campaign, Condition, conditions};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Sizes up to which one effect may stand in for another, typical ones.
pub(super) const STRETCH: f64 = 3.2;

/// The design of the fitted readings, and what it can do.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct Power {
    /// Different poses.
    pub poses: usize,
    /// Different loads.
    pub loads: usize,
    /// Directions of approach, at most.
    pub directions: usize,
    /// Readings of one pose, load and direction, at most.
    pub repeats: usize,
    /// Are orientations measured?
    pub orientation: bool,
    /// Are wrist wrenches measured beside a known payload?
    pub wrench: bool,
    /// Rows measured.
    pub rows: usize,
    /// Directions that the base model takes of them.
    pub taken: usize,
    /// Effects of which a typical size would show.
    pub visible: usize,
    /// Those of them that no single other one could stand in for.
    pub apart: usize,
}

impl Power {
    /// The design alone.
    pub fn of(campaign: &Campaign) -> Self {
        let readings = super::fitted(campaign);
        let conditions = conditions(&readings, campaign.noise.as_ref());
        let count = |of: fn(&Condition) -> usize| {
            let all: BTreeSet<usize> = conditions.iter().map(of).collect();
            all.len()
        };
        let mut cells = BTreeMap::new();
        for condition in &conditions {
            *cells.entry(condition).or_insert(0) += 1;
        }
        Self {
            poses: count(|c| c.pose),
            loads: count(|c| c.load),
            directions: count(|c| c.direction),
            repeats: cells.into_values().max().unwrap_or(0),
            orientation: readings.iter().any(|reading| reading.orientation.is_some()),
            wrench: readings
                .iter()
                .any(|reading| crate::campaign::wrench_is_measured(reading)),
            ..Self::default()
        }
    }

    /// The same with what it can see of these families; `tried` are those that it can see at all.
    pub fn seeing(
        self,
        families: &[Family],
        scores: &[FamilyScore],
        tried: &[usize],
        information: &Information,
    ) -> Self {
        let of = |&other: &usize| information.factor(&families[other].columns, STRETCH);
        let factors: Vec<_> = tried.par_iter().map(of).collect();
        let alone = |&&family: &&usize| {
            let own = &families[family].columns;
            let others = tried.iter().zip(&factors);
            others
                .filter(|&(&other, _)| !families[other].is_form_of(&families[family]))
                .all(|(&other, factor)| {
                    let columns = &families[other].columns;
                    information.beside(own, columns, factor.as_ref()) >= VISIBLE
                })
        };
        let seen = |&&family: &&usize| scores[family].expected >= VISIBLE;
        // an effect is counted once, in the first of its forms that is seen
        let seen: Vec<&usize> = tried.iter().filter(seen).collect();
        let first = |place: &usize| {
            let form = |other: &&usize| families[**other].is_form_of(&families[*seen[*place]]);
            !seen[..*place].iter().any(form)
        };
        let once: Vec<&usize> = (0..seen.len()).filter(first).map(|k| seen[k]).collect();
        Self {
            visible: once.len(),
            apart: once.par_iter().filter(|family| alone(family)).count(),
            ..self
        }
    }

    /// Can it name anything? Not if hardly one in four of the effects that it could see is no other one.
    pub fn is_enough(&self) -> bool {
        self.apart > 0 && 4 * self.apart >= self.visible
    }

    /// What would help, in words.
    pub fn lacks(&self) -> Vec<String> {
        let mut lacks = Vec::new();
        if self.poses < 15 {
            lacks.push(format!("30 poses or so (it has {})", self.poses));
        }
        if self.loads < 2 {
            lacks.push("two loads, one of them some kilograms".to_owned());
        }
        if self.directions < 2 {
            lacks.push("each pose approached from both sides".to_owned());
        }
        if self.repeats < 2 {
            lacks.push("each reading twice, to know the noise".to_owned());
        }
        if !self.orientation {
            lacks.push("orientations of the target".to_owned());
        }
        if !self.wrench {
            lacks.push("wrist wrenches beside the known payload".to_owned());
        }
        lacks
    }
}
