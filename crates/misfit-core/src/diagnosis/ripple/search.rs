//! A search for waves on some of the poses: the best is taken up, and the scan goes on without what it explains.

use super::grid::{Grid, Moments, STEPS};
use super::lane::{Columns, Lane};
use super::sums::{Column, Sums};
use crate::diagnosis::score::Against;
use crate::fit::normal::Normal;
use crate::fit::solve;
use nalgebra::{Cholesky, DMatrix, DVector, Matrix2};
use rayon::prelude::*;

/// Waves of a joint are at least this apart, in periods over its range.
const MIN_PERIODS_APART: f64 = 1.0;
/// Frequencies this near to the best, in nats, explain the readings as well.
const MAX_NATS_OF_ALIAS: f64 = 3.0;
/// Steps that refine all cycles together.
const REFINEMENTS: usize = 6;
/// Golden sections of a peak: to a hundred-thousandth of its width.
const SECTIONS: usize = 24;

/// A wave as the search knows it.
#[derive(Debug, Clone)]
pub struct Peak {
    /// Place of the joint.
    pub joint: usize,
    /// Cycles per turn.
    pub cycles: f64,
    /// Probability of such a wave from noise alone.
    pub p_value: f64,
    /// Other cycles of this joint that explain the readings as well.
    pub also: Vec<f64>,
}

/// A joint's products with what the model can do and what is left over.
struct Products {
    /// With orthonormal columns that span the base model and, behind them, the waves found; postures by columns.
    basis: Columns,
    /// With what they leave of the residual, by postures.
    residual: DVector<f64>,
    /// With what the base model alone leaves.
    of_base: DVector<f64>,
}

/// A search on some of the folds.
pub struct Search<'a> {
    sums: &'a Sums,
    postures: Vec<usize>,
    /// Rows of readings.
    rows: usize,
    /// Directions of the basis, and those of them that are the base model's.
    directions: usize,
    rank: usize,
    /// Squared lengths of what they leave of the residual, and of what the base model alone leaves.
    left: f64,
    left_by_base: f64,
    products: Vec<Products>,
    /// By joints; none with too few angles.
    lanes: Vec<Option<Lane<'a>>>,
    /// Is the noise what is left over?
    own_noise: bool,
    against: Against,
    /// Independent frequencies of all joints.
    pub trials: f64,
    /// Waves, in the order in which they were found.
    pub found: Vec<Peak>,
}

impl<'a> Search<'a> {
    /// Nothing found yet.
    pub fn new(
        sums: &'a Sums,
        grids: &'a [Option<Grid>],
        folds: &[usize],
        against: Against,
        own_noise: bool,
    ) -> Self {
        let postures = sums.postures(folds);
        let (rows, Normal(gram)) = sums.base(folds);
        let base = gram.nrows() - 1;
        let root = orthonormal(&gram.view((0, 0), (base, base)).into_owned());
        let along: DVector<f64> = root.tr_mul(&gram.view((0, base), (base, 1)).column(0));
        let left = gram[(base, base)] - along.norm_squared();
        let of = |joint: &super::sums::Turning| {
            let basis = joint.with_base.select_rows(&postures) * &root;
            let residual = joint.with_residual.select_rows(&postures) - &basis * &along;
            Products {
                basis: Columns::new(basis),
                of_base: residual.clone(),
                residual,
            }
        };
        let mut search = Self {
            rows,
            directions: root.ncols(),
            rank: root.ncols(),
            left,
            left_by_base: left,
            products: sums.joints.iter().map(of).collect(),
            lanes: Vec::new(),
            own_noise,
            against,
            trials: 0.0,
            found: Vec::new(),
            sums,
            postures,
        };
        search.settle_noise();
        let lane = |(joint, grid): (usize, &'a Option<Grid>)| {
            let grid = grid.as_ref()?;
            let moments = grid.moments(folds, &root, along.as_slice());
            search.lane(joint, grid, moments)
        };
        search.lanes = grids.par_iter().enumerate().map(lane).collect();
        search.trials = search.lanes.iter().flatten().map(|lane| lane.trials).sum();
        search
    }

    /// Where nothing else says how large the noise is, it is what is left.
    fn settle_noise(&mut self) {
        if self.own_noise {
            let dof = self.rows.saturating_sub(self.directions).max(1) as f64;
            self.against = Against {
                variance: self.left / dof,
                dof: Some(dof),
            };
        }
    }

    fn lane(&self, joint: usize, grid: &'a Grid, moments: Vec<Moments>) -> Option<Lane<'a>> {
        let postures = self.postures.iter();
        let angles = postures.map(|&p| self.sums.joints[joint].angles[p]);
        let cross = self.sums.cross(joint, joint).select_rows(&self.postures);
        let own = &self.products[joint];
        let angles: Vec<f64> = angles.collect();
        Lane::new(
            grid,
            moments,
            &angles,
            &cross,
            own.basis.all(),
            &own.residual,
        )
    }

    /// By joint: the height of the pair that stands highest over its frequencies, and its place.
    fn heights(&self) -> Vec<Option<(f64, usize)>> {
        let variance = self.against.variance;
        let of = |(joint, lane): (usize, &Option<Lane<'_>>)| {
            let lane = lane.as_ref()?;
            let mut best: Option<(f64, usize)> = None;
            for (place, moments) in lane.moments.iter().enumerate() {
                let chi2 = moments.chi2(variance);
                if best.is_none_or(|b| chi2 > b.0)
                    && self.is_free(joint, lane.grid.frequency(place))
                {
                    best = Some((chi2, place));
                }
            }
            best
        };
        self.lanes.par_iter().enumerate().map(of).collect()
    }

    /// The highest of the pairs of these joints, its cycles refined.
    fn best(&self, heights: &[Option<(f64, usize)>], joints: &[bool]) -> Option<Peak> {
        let variance = self.against.variance;
        let mut best: Option<(f64, usize, usize)> = None;
        for (joint, height) in heights.iter().enumerate() {
            if let &Some((chi2, place)) = height
                && joints[joint]
                && best.is_none_or(|b| chi2 > b.0)
            {
                best = Some((chi2, joint, place));
            }
        }
        let (_, joint, place) = best?;
        let lane = self.lanes[joint].as_ref()?;
        let middle = lane.grid.frequency(place);
        let (cycles, chi2) = highest(middle - lane.grid.step, middle + lane.grid.step, |cycles| {
            lane.at(cycles).chi2(variance)
        });
        let pair = self.against.p_value(chi2, 2.0);
        // z = -ln p, capped where p is zero in the computer's numbers
        let root = (-pair.max(f64::MIN_POSITIVE).ln()).sqrt();
        Some(Peak {
            joint,
            cycles,
            p_value: (pair * (1.0 + self.trials * root)).min(1.0),
            also: self.rivals(lane, cycles, chi2),
        })
    }

    /// May a wave be taken up here? Two nearer than a period over the range only beat with each other.
    fn is_free(&self, joint: usize, cycles: f64) -> bool {
        let Some(lane) = &self.lanes[joint] else {
            return false;
        };
        let here = self.found.iter().filter(|peak| peak.joint == joint);
        let known = self.sums.joints[joint].known.iter().copied();
        here.map(|peak| peak.cycles)
            .chain(known)
            .all(|other| (other - cycles).abs() >= MIN_PERIODS_APART * lane.grid.period)
    }

    /// Other frequencies of the joint at which the readings are explained as well.
    fn rivals(&self, lane: &Lane<'_>, cycles: f64, chi2: f64) -> Vec<f64> {
        let variance = self.against.variance;
        let chi2_of = |moments: &Moments| moments.chi2(variance);
        let heights: Vec<f64> = lane.moments.iter().map(chi2_of).collect();
        let is_peak = |&place: &usize| {
            let near = &heights[place.saturating_sub(1)..(place + 2).min(heights.len())];
            heights[place] > chi2 - 2.0 * MAX_NATS_OF_ALIAS
                && near.iter().all(|&other| other <= heights[place])
                && (lane.grid.frequency(place) - cycles).abs() >= lane.grid.period
        };
        let peaks = (0..heights.len()).filter(is_peak);
        peaks.map(|place| lane.grid.frequency(place)).collect()
    }

    /// Leaves the first waves alone.
    pub fn truncate(&mut self, keep: usize) {
        self.found.truncate(keep);
        let (_, left) = self.amplitudes(&self.gram(&self.pairs()));
        if self.own_noise {
            let dof = self.rows.saturating_sub(self.rank + 2 * keep);
            self.against.variance = left / dof.max(1) as f64;
        }
    }

    /// Takes up waves until none is sure, or there are `most`. Between two scans each joint has its turn, the
    /// strongest first: waves of different joints are nearly independent, and each is judged beside those taken.
    pub fn grow(&mut self, alarm: f64, most: usize) {
        loop {
            let mut joints = vec![true; self.lanes.len()];
            let before = self.found.len();
            let mut heights = self.heights();
            while self.found.len() < most {
                if self.own_noise && self.found.len() > before {
                    // their unit has changed
                    heights = self.heights();
                }
                let Some(peak) = self.best(&heights, &joints) else {
                    break;
                };
                joints[peak.joint] = false;
                if peak.p_value < alarm {
                    self.take(peak);
                } else if self.found.len() == before {
                    // the strongest of a fresh scan is noise, and so are all others
                    return;
                }
            }
            if self.found.len() == most || self.found.len() == before {
                return;
            }
            self.lanes.par_iter_mut().flatten().for_each(Lane::update);
        }
    }

    /// Takes up a wave: what is new in its pair joins the basis. Nothing happens if nothing of it is new.
    fn take(&mut self, peak: Peak) {
        let sums = self.sums;
        let [sin, cos] = sums.pair(&self.postures, peak.joint, peak.cycles, 1.0);
        let own = &self.products[peak.joint];
        let pair = DMatrix::from_columns(&[sin.values.clone(), cos.values.clone()]);
        let along = own.basis.all().tr_mul(&pair);
        let product = |a: &Column, b: &Column| sums.product(&self.postures, a, b);
        let (ss, sc, cc) = (
            product(&sin, &sin),
            product(&sin, &cos),
            product(&cos, &cos),
        );
        let shared = along.tr_mul(&along);
        let inner = Matrix2::new(ss, sc, sc, cc) - shared.fixed_view::<2, 2>(0, 0);
        let Some(factor) = Cholesky::new(inner) else {
            return;
        };
        // pair = basis · along + fresh · turn
        let Some(turn) = factor.l().transpose().try_inverse() else {
            return;
        };
        let with_left = pair.tr_mul(&own.residual);
        let taken = turn.transpose() * with_left;
        self.left -= taken.norm_squared();
        let joints = self.products.par_iter_mut().enumerate();
        joints.for_each(|(joint, products)| {
            let cross = sums.cross(joint, peak.joint).select_rows(&self.postures);
            let mut fresh = -(products.basis.all() * &along);
            for (mut fresh, wave) in fresh.column_iter_mut().zip(pair.column_iter()) {
                fresh += cross.component_mul(&wave);
            }
            let fresh = fresh * turn;
            products.residual -= &fresh * taken;
            products.basis.push(fresh.as_view());
        });
        self.directions += 2;
        let lanes = self.lanes.par_iter_mut().zip(&self.products);
        lanes.for_each(|(lane, products)| {
            if let Some(lane) = lane {
                let basis = products.basis.all();
                lane.push(basis.columns(basis.ncols() - 2, 2), &products.residual);
            }
        });
        self.found.push(peak);
        self.settle_noise();
    }

    /// All pairs.
    fn pairs(&self) -> Vec<Column> {
        let pair = |peak: &Peak| self.sums.pair(&self.postures, peak.joint, peak.cycles, 1.0);
        self.found.iter().flat_map(pair).collect()
    }

    /// What moves when the cycles do: derivative of each wave by its own.
    fn rates(&self, amplitudes: &DVector<f64>) -> Vec<Column> {
        let rate = |(k, peak): (usize, &Peak)| {
            let all = &self.sums.joints[peak.joint].angles;
            let angles =
                DVector::from_iterator(self.postures.len(), self.postures.iter().map(|&p| all[p]));
            let (a, b) = (amplitudes[2 * k], amplitudes[2 * k + 1]);
            // from the middle of the angles: a shift of it is only another phase
            let middle = 0.5 * (angles.min() + angles.max());
            Column {
                joint: peak.joint,
                values: angles.map(|q| {
                    let (sin, cos) = (peak.cycles * q).sin_cos();
                    (q - middle) * (a * cos - b * sin)
                }),
            }
        };
        self.found.iter().enumerate().map(rate).collect()
    }

    /// Products of columns with each other and, last, the residual, the base model taken out.
    fn gram(&self, columns: &[Column]) -> DMatrix<f64> {
        let n = columns.len();
        let mut gram = DMatrix::zeros(n + 1, n + 1);
        let along: Vec<DVector<f64>> = columns
            .par_iter()
            .map(|column| {
                let basis = self.products[column.joint].basis.all();
                basis.columns(0, self.rank).tr_mul(&column.values)
            })
            .collect();
        let rows: Vec<Vec<f64>> = (0..n)
            .into_par_iter()
            .map(|a| {
                let product = |b: usize| {
                    self.sums.product(&self.postures, &columns[a], &columns[b])
                        - along[a].dot(&along[b])
                };
                (0..=a).map(product).collect()
            })
            .collect();
        for (a, row) in rows.iter().enumerate() {
            for (b, &product) in row.iter().enumerate() {
                (gram[(a, b)], gram[(b, a)]) = (product, product);
            }
            let residual = self.products[columns[a].joint]
                .of_base
                .dot(&columns[a].values);
            (gram[(a, n)], gram[(n, a)]) = (residual, residual);
        }
        gram[(n, n)] = self.left_by_base;
        gram
    }

    /// Amplitudes of all waves together, rad, and what they leave of the misfit; from the products of their pairs, first.
    fn amplitudes(&self, gram: &DMatrix<f64>) -> (DVector<f64>, f64) {
        let (n, last) = (2 * self.found.len(), gram.nrows() - 1);
        let right = gram.view((0, last), (n, 1)).column(0).into_owned();
        let inner = gram.view((0, 0), (n, n)).into_owned();
        let found = Cholesky::new(inner).map(|c| c.solve(&right));
        match found {
            Some(found) => {
                let left = self.left_by_base - found.dot(&right);
                (found, left)
            }
            None => (DVector::zeros(n), self.left_by_base),
        }
    }

    /// Period over a joint's range, cycles a turn.
    fn period(&self, joint: usize) -> f64 {
        self.lanes[joint]
            .as_ref()
            .map_or(0.0, |lane| lane.grid.period)
    }

    /// Refines all cycles together; amplitudes (rad) and one standard deviation of the cycles.
    pub fn refine(&mut self) -> (DVector<f64>, Vec<f64>) {
        let count = self.found.len();
        let (mut amplitudes, mut left) = self.amplitudes(&self.gram(&self.pairs()));
        let mut deviations = vec![f64::INFINITY; count];
        let peaks: Vec<f64> = self.found.iter().map(|peak| peak.cycles).collect();
        for _ in 0..REFINEMENTS {
            let mut columns = self.pairs();
            columns.extend(self.rates(&amplitudes));
            let gram = self.gram(&columns);
            // rates with the pairs partialled out as well: the normal equations of the cycles alone
            let pairs = 2 * count;
            let Some(inner) = Cholesky::new(gram.view((0, 0), (pairs, pairs)).into_owned()) else {
                break;
            };
            let beside = gram.view((0, pairs), (pairs, count + 1)).into_owned();
            let alone = gram
                .view((pairs, pairs), (count + 1, count + 1))
                .into_owned()
                - beside.tr_mul(&inner.solve(&beside));
            let mut normal = alone.view((0, 0), (count, count)).into_owned();
            for (k, peak) in self.found.iter().enumerate() {
                // a peak is no wider: neighbours would trade places
                let width = self.period(peak.joint) / STEPS;
                normal[(k, k)] += self.against.variance / width.powi(2);
            }
            let Some(normal) = Cholesky::new(normal) else {
                break;
            };
            let inverse = normal.inverse();
            for (k, deviation) in deviations.iter_mut().enumerate() {
                *deviation = (inverse[(k, k)] * self.against.variance).sqrt();
            }
            let right: DVector<f64> = alone.view((0, count), (count, 1)).column(0).into_owned();
            let step = normal.solve(&right);
            let before: Vec<f64> = self.found.iter().map(|peak| peak.cycles).collect();
            let periods: Vec<f64> = self.found.iter().map(|p| self.period(p.joint)).collect();
            for (k, peak) in self.found.iter_mut().enumerate() {
                let most = 0.5 * periods[k] / STEPS;
                let here = peak.cycles + step[k].clamp(-most, most);
                // waves that met would only beat with each other
                peak.cycles = here.clamp(peaks[k] - 2.0 * most, peaks[k] + 2.0 * most);
            }
            let (next, reached) = self.amplitudes(&self.gram(&self.pairs()));
            if reached >= left {
                for (peak, cycles) in self.found.iter_mut().zip(before) {
                    peak.cycles = cycles;
                }
                break;
            }
            let settled = left - reached < 1e-3 * self.against.variance;
            (amplitudes, left) = (next, reached);
            if settled {
                break;
            }
        }
        for (peak, deviation) in self.found.iter_mut().zip(&deviations) {
            peak.cycles = rounded(peak.cycles, *deviation);
        }
        (self.amplitudes(&self.gram(&self.pairs())).0, deviations)
    }
}

/// What columns with these products of each other are to be multiplied by, to make of them orthonormal ones that span
/// the directions that count.
fn orthonormal(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = gram.clone().symmetric_eigen();
    let counts = |&k: &usize| eigen.eigenvalues[k].max(0.0).sqrt() >= solve::WEAK;
    let kept: Vec<usize> = (0..gram.ncols()).filter(counts).collect();
    let mut root = eigen.eigenvectors.select_columns(&kept);
    for (column, &k) in kept.iter().enumerate() {
        root.column_mut(column)
            .scale_mut(1.0 / eigen.eigenvalues[k].sqrt());
    }
    root
}

/// The highest point between two, by golden sections.
fn highest(mut low: f64, mut high: f64, of: impl Fn(f64) -> f64) -> (f64, f64) {
    const SECTION: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (high - SECTION * (high - low), low + SECTION * (high - low));
    let (mut at_a, mut at_b) = (of(a), of(b));
    for _ in 0..SECTIONS {
        if at_a > at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - SECTION * (high - low);
            at_a = of(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + SECTION * (high - low);
            at_b = of(b);
        }
    }
    if at_a > at_b { (a, at_a) } else { (b, at_b) }
}

/// A number to the decimals that its deviation leaves sense in.
fn rounded(value: f64, deviation: f64) -> f64 {
    if !(deviation.is_finite() && deviation > 0.0) {
        return value;
    }
    let unit = 10f64.powi((deviation / 5.0).log10().floor().clamp(-6.0, 0.0) as i32);
    let inverse = (1.0 / unit).round();
    (value * inverse).round() / inverse
}
