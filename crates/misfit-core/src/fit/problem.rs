//! Readings and a model as a least-squares problem: the rows of `[J | r]`, whitened and scaled.
//!
//! A model's answer to repeats is computed once. Where the fit needs only what all rows say together, repeats are added up.

use super::alike::Alike;
use super::folds::FOLDS;
use super::noise::Whitener;
use super::residuals::residual;
use super::solve::{self, Linear, Problem};
use super::triangle::triangle;
use crate::campaign::Reading;
use crate::dual_quaternion::rotation_vector;
use crate::model::{Model, Row, Rows, Workspace, right_jacobian_inverse, stacked};
use nalgebra::{DMatrix, Matrix6, Vector3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Readings a block: large enough to amortise a QR factorisation, fixed so that sums do not depend on threads.
const BLOCK: usize = 48;
/// Readings that are not alike from which on a fit begins with some of them.
const MANY: usize = 2_000;
/// One in so many of them: a prime, so that a design's loads and directions, which go round, are all there.
const ONE_IN: usize = 7;

/// A model and readings as a least-squares problem over the free parameters.
pub struct CampaignProblem<'a> {
    model: &'a Model,
    readings: &'a [&'a Reading],
    whiteners: &'a [Whitener],
    free: &'a [usize],
    held: &'a [f64],
    wanted: Vec<bool>,
    scale: Vec<f64>,
    bounds: Vec<(f64, f64)>,
    alike: Alike,
    /// By groups of a model that gives way: the one found last, from where the next is near; empty before the first.
    equilibria: Vec<Mutex<Vec<f64>>>,
    /// By groups: may their readings be added up?
    sums: Vec<bool>,
    /// Groups in the order in which their rows are added up.
    order: Vec<usize>,
    /// Ranges of that order, of some [`BLOCK`] readings or sums each.
    parts: Vec<Range<usize>>,
    /// Numbers of the parts of each fold, where they are told apart.
    folds: Vec<usize>,
}

impl<'a> CampaignProblem<'a> {
    /// The problem of the parameters `free`, all others at their values in `held`: both by the model's vector, SI.
    pub fn new(
        model: &'a Model,
        readings: &'a [&'a Reading],
        whiteners: &'a [Whitener],
        free: &'a [usize],
        held: &'a [f64],
    ) -> Self {
        let alike = Alike::of(model, readings);
        Self::of(alike, model, readings, whiteners, free, held)
    }

    /// The same where it is known which readings are alike.
    pub(super) fn of(
        alike: Alike,
        model: &'a Model,
        readings: &'a [&'a Reading],
        whiteners: &'a [Whitener],
        free: &'a [usize],
        held: &'a [f64],
    ) -> Self {
        let parameters: Vec<_> = model.parameters().map(|(_, parameter)| parameter).collect();
        let mut wanted = vec![false; parameters.len()];
        for &k in free {
            wanted[k] = true;
        }
        let gives_way = alike.groups.iter().filter(|_| model.is_elastic());
        let equilibria = gives_way.map(|_| Mutex::default()).collect();
        let groups = alike.groups.par_iter();
        let sums = groups.map(|group| may_be_summed(readings, whiteners, group));
        let sums: Vec<bool> = sums.collect();
        let order = (0..alike.groups.len()).collect();
        let mut problem = Self {
            equilibria,
            alike,
            sums,
            order,
            parts: Vec::new(),
            folds: Vec::new(),
            model,
            readings,
            whiteners,
            free,
            held,
            wanted,
            scale: free.iter().map(|&k| parameters[k].typical).collect(),
            bounds: free
                .iter()
                .map(|&k| (parameters[k].lower, parameters[k].upper))
                .collect(),
        };
        problem.parts = problem.parted(0..problem.order.len());
        problem
    }

    /// The same with each fold's part of the problem beside the whole, by the fold of each reading; as it was where there are
    /// no folds, few readings, or some of several folds that are alike.
    pub(super) fn in_folds(mut self, of: &[usize]) -> Self {
        let groups = &self.alike.groups;
        if of.is_empty() || groups.len() < MANY {
            return self;
        }
        let fold = |group: usize| of[groups[group][0]];
        if groups
            .iter()
            .flatten()
            .any(|&i| of[i] != fold(self.alike.group_of[i]))
        {
            return self;
        }
        let mut order = self.order.clone();
        order.sort_by_key(|&group| fold(group));
        let first = |number| order.partition_point(|&group| fold(group) < number);
        let ranges: Vec<Range<usize>> = (0..FOLDS).map(|k| first(k)..first(k + 1)).collect();
        self.order = order;
        let parts: Vec<Vec<Range<usize>>> =
            ranges.into_iter().map(|own| self.parted(own)).collect();
        self.folds = parts.iter().map(Vec::len).collect();
        self.parts = parts.into_iter().flatten().collect();
        self
    }

    /// A range of groups in ranges of some [`BLOCK`] readings or sums each.
    fn parted(&self, range: Range<usize>) -> Vec<Range<usize>> {
        let mut parts: Vec<Range<usize>> = Vec::new();
        let mut count = BLOCK;
        for place in range {
            if count >= BLOCK {
                parts.push(place..place);
                count = 0;
            }
            let group = self.order[place];
            count += if self.sums[group] {
                1
            } else {
                self.alike.groups[group].len()
            };
            if let Some(part) = parts.last_mut() {
                part.end = place + 1;
            }
        }
        parts
    }

    /// All parameters, the free ones from `p`, SI.
    pub fn full(&self, p: &[f64]) -> Vec<f64> {
        let mut full = self.held.to_vec();
        for (&k, &value) in self.free.iter().zip(p) {
            full[k] = value;
        }
        full
    }

    /// All rows of `[J | r]` at `p` (SI), in units of the noise and of typical sizes, in blocks of readings in their order.
    /// Readings that are alike cost one evaluation where they follow each other.
    pub fn blocks(&self, p: &[f64]) -> Vec<DMatrix<f64>> {
        self.blocks_of(p, &self.alike.group_of, false)
    }

    /// The same where all effects that read the clock have parameters of zero, with which they do nothing: repeats have one
    /// prediction, and each its own derivatives.
    pub fn blocks_at_rest(&self, p: &[f64]) -> Vec<DMatrix<f64>> {
        self.blocks_of(p, &Alike::by(self.readings, false).group_of, true)
    }

    fn blocks_of(&self, p: &[f64], group_of: &[usize], each: bool) -> Vec<DMatrix<f64>> {
        let all: Vec<usize> = (0..self.readings.len()).collect();
        let chunks: Vec<&[usize]> = all.chunks(BLOCK).collect();
        self.map_blocks(p, chunks.len(), |chunk, place| {
            let groups = chunks[chunk].chunk_by(|&a, &b| group_of[a] == group_of[b]);
            place.block(groups.map(|group| (group, 1)), None, each).0
        })
    }

    /// What `then` makes of the numbers below `count`, with room to compute rows at `p`.
    fn map_blocks<R: Send>(
        &self,
        p: &[f64],
        count: usize,
        then: impl Fn(usize, &mut Place<'_>) -> R + Sync,
    ) -> Vec<R> {
        let full = self.full(p);
        let place = || Place {
            problem: self,
            full: &full,
            workspace: Workspace::new(&self.model.setup),
            jacobian: Rows::zeros(full.len()),
        };
        let all = (0..count).into_par_iter();
        all.map_init(place, |place, index| then(index, place))
            .collect()
    }

    /// Where a fit of some of the readings ends, from where that of all has a step or two to go; the beginning if they are
    /// few, or if it does not converge.
    pub(super) fn ahead(&self, begin: Vec<f64>, centre: &[f64]) -> Vec<f64> {
        let groups = &self.alike.groups;
        if groups.len() < MANY {
            return begin;
        }
        let some = groups.iter().step_by(ONE_IN).flatten();
        let (readings, whiteners): (Vec<&Reading>, Vec<Whitener>) = some
            .map(|&index| (self.readings[index], self.whiteners[index].clone()))
            .unzip();
        let (model, free, held) = (self.model, self.free, self.held);
        let part = CampaignProblem::new(model, &readings, &whiteners, free, held);
        let found = solve::solve(&part, &begin, centre, |_, _| {});
        if found.converged { found.p } else { begin }
    }
}

impl Problem for CampaignProblem<'_> {
    fn linearise(&self, p: &[f64]) -> Linear {
        // each group has its one place here, whatever the threads: so it may begin where it ended last
        let known = (!self.equilibria.is_empty()).then_some(&self.equilibria[..]);
        let found = self.map_blocks(p, self.parts.len(), |part, place| {
            let groups = self.order[self.parts[part].clone()].iter().map(|&index| {
                let group = &self.alike.groups[index][..];
                let together = if self.sums[index] { group.len() } else { 1 };
                (group, together)
            });
            let (block, lacking) = place.block(groups, known, false);
            (triangle(block), lacking)
        });
        let mut found = found.into_iter();
        let mut reduced = |count: usize| {
            let found = found.by_ref().take(count);
            let (blocks, lacking): (Vec<_>, Vec<f64>) = found.unzip();
            let mut linear = solve::reduce(blocks, self.free.len());
            linear.rest += lacking.iter().sum::<f64>();
            linear
        };
        if self.folds.is_empty() {
            return reduced(self.parts.len());
        }
        let folds: Vec<Linear> = self.folds.iter().map(|&count| reduced(count)).collect();
        Linear {
            folds: folds.clone(),
            ..Linear::joined(folds.iter())
        }
    }

    fn scale(&self) -> &[f64] {
        &self.scale
    }

    fn bounds(&self) -> &[(f64, f64)] {
        &self.bounds
    }

    fn prior(&self) -> f64 {
        solve::WEAK
    }
}

/// Where rows are computed, by one thread.
struct Place<'a> {
    problem: &'a CampaignProblem<'a>,
    full: &'a [f64],
    workspace: Workspace,
    jacobian: Rows,
}

impl Place<'_> {
    /// One block of `[J | r]`, whitened and scaled, of groups of readings that are alike; so many of a group at a time
    /// become one: their sum over the root of their number. Also what the sums lack of the sum of squares of `r`. `known`
    /// are equilibria from which to seek the next, by groups of the problem; `each`: readings that are alike have the same
    /// prediction, but not the same derivatives.
    fn block<'g>(
        &mut self,
        groups: impl Iterator<Item = (&'g [usize], usize)> + Clone,
        known: Option<&[Mutex<Vec<f64>>]>,
        each: bool,
    ) -> (DMatrix<f64>, f64) {
        let CampaignProblem {
            model,
            readings,
            whiteners,
            free,
            scale,
            wanted,
            alike,
            ..
        } = self.problem;
        let n = free.len();
        let bundles = groups.clone().flat_map(|(group, size)| group.chunks(size));
        let count = bundles.map(|bundle| whiteners[bundle[0]].rows).sum();
        let mut block = DMatrix::zeros(count, n + 1);
        let mut lacking = 0.0;
        let mut row = 0;
        for (group, size) in groups {
            let first = readings[group[0]];
            let jacobian = &mut self.jacobian;
            let workspace = &mut self.workspace;
            let prediction = match known {
                Some(known) => {
                    let known = &known[alike.group_of[group[0]]];
                    let mut near = known.lock().unwrap_or_else(PoisonError::into_inner);
                    let found = workspace.prepare(model, self.full, first, &near);
                    if found.settled {
                        near.clear();
                        near.extend_from_slice(workspace.deviations());
                    }
                    found
                }
                None => workspace.prepare(model, self.full, first, &[]),
            };
            workspace.derivative(model, self.full, wanted, first, jacobian);
            for (place, bundle) in group.chunks(size).enumerate() {
                if each && place > 0 {
                    workspace.derivative(model, self.full, wanted, readings[bundle[0]], jacobian);
                }
                let mut through = Matrix6::zeros();
                let mut sum = Row::zeros();
                let mut squares = 0.0;
                for &index in bundle {
                    let residual = residual(&prediction, readings[index]);
                    // residual = measured - predicted, so its derivative is minus the prediction's; the rotation
                    // vector of the error answers through the inverse right Jacobian
                    let turn = right_jacobian_inverse(&residual.fixed_rows::<3>(3).into_owned());
                    through += whiteners[index].through(&turn);
                    whiteners[index].apply(&residual, &mut |i, value| {
                        sum[i] += value;
                        squares += value * value;
                    });
                }
                let whitener = &whiteners[bundle[0]];
                let many = bundle.len() as f64;
                through /= many;
                sum /= many.sqrt();
                for (column, &k) in free.iter().enumerate() {
                    let rate = jacobian.column(k).into_owned();
                    let scale = -scale[column] * many.sqrt();
                    whitener.apply_through(&through, &rate, &mut |i, value| {
                        block[(row + i, column)] = value * scale
                    });
                }
                for i in 0..whitener.rows {
                    block[(row + i, n)] = sum[i];
                }
                if bundle.len() > 1 {
                    lacking += squares - sum.norm_squared();
                }
                row += whitener.rows;
            }
        }
        (block, lacking)
    }
}

/// May these repeats be added up? Where their whitening is the same, the rows of their sum say all that the rows of each
/// do; where it is nearly so, what that changes of a parameter's gradient is to be small beside one row's noise.
fn may_be_summed(readings: &[&Reading], whiteners: &[Whitener], group: &[usize]) -> bool {
    /// Share of a row's noise.
    const SMALL: f64 = 1e-3;
    let (first, rest) = (group[0], &group[1..]);
    let seen = readings[first];
    rest.iter().all(|&index| {
        let other = readings[index];
        let turn = match (seen.orientation, other.orientation) {
            (Some(a), Some(b)) => rotation_vector(&(b * a.inverse()).into_inner()),
            (None, None) => Vector3::zeros(),
            _ => return false,
        };
        let mut apart = Row::zeros();
        apart
            .fixed_rows_mut::<6>(0)
            .copy_from(&stacked(&(other.position - seen.position), &turn));
        let unlike = whiteners[first].unlike(&whiteners[index]) + turn.norm();
        unlike * whiteners[first].squares(&apart).sqrt() < SMALL
    })
}
