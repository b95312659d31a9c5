//! Waves of unknown frequency in the error of a joint: a scan over cycles per turn.
//!
//! For every joint `j` and number of cycles `N` the score of the pair `g_j sin N q_j`, `g_j cos N q_j` is taken
//! with the base model partialled out (`g_j`: whitened motion of the target by the joint). The best pair is
//! taken up, its cycles refined, and the scan goes on for the next until none stands above noise. How many of
//! them are kept is decided by cross-validation, in which each fold searches anew.
//!
//! The probability of a peak from noise alone counts all frequencies tried: with `p` that of the pair alone and
//! `z = -ln p`, at most `p (1 + W √z)`, where `W = ΔN √(4π var q) / 2π` is the number of independent frequencies.
//! Source: Baluev 2008, *Assessing the statistical significance of periodogram peaks*, MNRAS 385, 1279.

use super::folds;
use super::motion::Motion;
use super::score::Against;
use crate::campaign::Reading;
use crate::effects::find;
use crate::fit::noise::Source;
use crate::fit::triangle::triangle;
use crate::fit::{Fit, solve};
use crate::model::Model;
use crate::robot::JointKind;
use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// The effect whose cycles are found.
pub const EFFECT: &str = "gear_ripple";
/// Cycles a turn that `transmission_error` takes care of; waves begin one period over a joint's range above.
const SLOWEST: f64 = 2.0;
/// Cycles a turn up to which waves are looked for: two an input turn of a gear of ratio 160.
const FASTEST: f64 = 320.0;
/// Steps of the scan a period over the joint's range: a peak loses 3 % of its height at most between two.
const STEPS: f64 = 4.0;
/// Different angles that a joint must have been at.
const ANGLES: usize = 10;
/// Waves of a joint are at least this apart, in periods over its range.
const APART: f64 = 1.0;
/// Waves taken up at most in one search.
const MOST: usize = 48;
/// Typical amplitude, rad.
const TYPICAL: f64 = 3e-5;
/// Pairs whose weaker direction has less than this (σ for a typical amplitude) are not counted.
const FAINT: f64 = 0.05;
/// Frequencies this near to the best, in nats, explain the readings as well.
const NEAR: f64 = 3.0;
/// Frequencies in one product of matrices.
const BATCH: usize = 64;
/// Steps that refine all cycles together.
const REFINEMENTS: usize = 6;
/// Golden sections of a peak: to a hundred-thousandth of its width.
const SECTIONS: usize = 24;

/// One wave found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Wave {
    /// Joint.
    pub joint: String,
    /// Cycles per turn.
    pub cycles: f64,
    /// One standard deviation of them.
    pub cycles_std: f64,
    /// Amplitude, rad.
    pub amplitude_rad: f64,
    /// Probability of such a wave at any frequency of any joint from noise alone.
    pub p_value: f64,
    /// Other cycles of this joint that explain the readings as well.
    pub also: Vec<f64>,
}

/// What the scan says.
pub struct Found {
    /// Waves, in the order in which they were found.
    pub waves: Vec<Wave>,
    /// What the frequencies tried cost in evidence, nats.
    pub trials: f64,
}

/// Waves of a model: joint and cycles, as its parameters are named.
pub fn of(model: &Model) -> Vec<(String, f64)> {
    let parameters = model.term(EFFECT).map_or(&[][..], |term| &term.parameters);
    let wave = |name: &str| {
        let (joint, cycles) = name.rsplit_once(".sin")?;
        Some((joint.to_owned(), cycles.parse().ok()?))
    };
    let names = parameters.iter().map(|parameter| parameter.name.as_str());
    names.filter_map(wave).collect()
}

/// The model with these waves beside those that it has, which keep their values.
pub fn with(model: &Model, waves: &[Wave]) -> Option<Model> {
    let mut table = toml::Table::new();
    let found = waves.iter().map(|wave| (wave.joint.clone(), wave.cycles));
    for (joint, cycles) in of(model).into_iter().chain(found) {
        let list = table
            .entry(joint)
            .or_insert_with(|| toml::Value::Array(Vec::new()));
        if let toml::Value::Array(list) = list {
            list.push(cycles.into());
        }
    }
    let mut options = toml::Table::new();
    options.insert("cycles".to_owned(), table.into());
    let effect = find(EFFECT)?.make(options).ok()?;
    let mut next = model.without(EFFECT).with(&effect);
    if let (Some(old), Some(term)) = (model.term(EFFECT), next.terms.last_mut()) {
        for parameter in &mut term.parameters {
            let before = old.parameters.iter().find(|p| p.name == parameter.name);
            if let Some(before) = before {
                *parameter = before.clone();
            }
        }
    }
    Some(next)
}

/// Gives waves the amplitudes of a fit.
pub fn settle(waves: &mut [Wave], fit: &Fit) {
    for wave in waves {
        let value = |term: &str| {
            let name = format!("{}.{term}{}", wave.joint, wave.cycles);
            fit.index(EFFECT, &name).map(|index| fit.values[index])
        };
        if let (Some(sin), Some(cos)) = (value("sin"), value("cos")) {
            wave.amplitude_rad = sin.hypot(cos);
        }
    }
}

/// A joint that turns, its angles and the whitened motion of the target by it.
struct Turning {
    name: String,
    /// By readings, rad.
    angles: Vec<f64>,
    /// By rows.
    motion: DVector<f64>,
    /// Waves that the base model has already.
    known: Vec<f64>,
}

/// What is scanned.
pub struct Scan {
    base: DMatrix<f64>,
    residual: DVector<f64>,
    joints: Vec<Turning>,
    /// First row of each reading, and one past the last.
    rows: Vec<usize>,
    folds: Vec<usize>,
    /// Is the noise what is left over?
    own_noise: bool,
}

impl Scan {
    /// `blocks` are rows of whitened columns, the first `base` of them those of the fit, the last the residual.
    pub fn new(
        fit: &Fit,
        readings: &[&Reading],
        motions: &[Motion],
        blocks: &[DMatrix<f64>],
        base: usize,
    ) -> Self {
        let setup = &fit.model.setup;
        let mut rows = vec![0];
        for motion in motions {
            rows.push(rows[rows.len() - 1] + motion.rates.nrows());
        }
        let all = rows[rows.len() - 1];
        let mut columns = DMatrix::zeros(all, base);
        let mut residual = DVector::zeros(all);
        let mut row = 0;
        for block in blocks {
            let count = block.nrows();
            columns
                .rows_mut(row, count)
                .copy_from(&block.columns(0, base));
            let last = block.column(block.ncols() - 1);
            residual.rows_mut(row, count).copy_from(&last);
            row += count;
        }
        let turns =
            |&(_, &joint): &(usize, &usize)| setup.robot.joints[joint].kind != JointKind::Prismatic;
        let turning = setup.observed.iter().enumerate().filter(turns);
        let known = of(&fit.model);
        let joints = turning.map(|(place, &joint)| {
            let name = setup.robot.joints[joint].name.clone();
            let known = known.iter().filter(|wave| wave.0 == name);
            let rates = motions
                .iter()
                .flat_map(|m| m.rates.column(place).into_iter());
            Turning {
                angles: readings.iter().map(|r| r.joints[joint]).collect(),
                motion: DVector::from_iterator(all, rates.copied()),
                known: known.map(|wave| wave.1).collect(),
                name,
            }
        });
        Self {
            joints: joints.collect(),
            base: columns,
            residual,
            rows,
            folds: folds::by_pose(readings),
            own_noise: fit.noise.source == Source::Residual,
        }
    }

    /// Looks for waves whose probability is below `alarm`; none where none of them predicts poses that it has not seen.
    pub fn waves(&self, against: &Against, alarm: f64) -> Option<Found> {
        let all: Vec<usize> = (0..self.folds.len()).collect();
        let mut search = Search::new(self, &all, *against);
        search.grow(alarm, MOST);
        if search.found.is_empty() {
            return None;
        }
        let keep = self.predicting(search.found.len(), against, alarm);
        if keep == 0 {
            // no wave predicts poses that it has not seen
            return None;
        }
        let trials = search.trials.max(1.0).ln();
        search.truncate(keep);
        let (amplitudes, deviations) = search.refine();
        let waves = search.found.iter().enumerate().map(|(k, peak)| Wave {
            joint: self.joints[peak.joint].name.clone(),
            cycles: peak.cycles,
            cycles_std: deviations[k],
            amplitude_rad: amplitudes[2 * k].hypot(amplitudes[2 * k + 1]),
            p_value: peak.p_value,
            also: peak.also.clone(),
        });
        Some(Found {
            waves: waves.collect(),
            // each wave pays for the frequencies tried
            trials: trials * keep as f64,
        })
    }

    /// How many waves predict poses left out as well as any number does, each fold searching for its own.
    fn predicting(&self, most: usize, against: &Against, alarm: f64) -> usize {
        let errors: Vec<Vec<f64>> = (0..folds::FOLDS)
            .into_par_iter()
            .map(|fold| {
                let part = |inside: bool| -> Vec<usize> {
                    let all = 0..self.folds.len();
                    all.filter(|&i| (self.folds[i] == fold) == inside).collect()
                };
                let (kept, tested) = (part(false), part(true));
                let mut search = Search::new(self, &kept, *against);
                // of fewer readings a wave of all may be less sure
                search.grow(alarm.sqrt(), most);
                let errors = self.tested(&search.found, &kept, &tested);
                (0..=most)
                    .map(|k| errors[k.min(errors.len() - 1)])
                    .collect()
            })
            .collect();
        let of = |k: usize| -> Vec<f64> { errors.iter().map(|fold| fold[k]).collect() };
        let total = |k: &usize| of(*k).iter().sum::<f64>();
        let least = (0..=most).min_by(|a, b| total(a).total_cmp(&total(b)));
        let best = of(least.unwrap_or(0));
        // the fewest that are not worse by more than chance, or by a share worth having
        (0..=most)
            .find(|&k| !folds::lower(&of(0), &of(k), &best))
            .unwrap_or(0)
    }

    /// Squared errors of the tested readings with none, one, … all of the waves fitted to the kept ones.
    fn tested(&self, waves: &[Peak], kept: &[usize], tested: &[usize]) -> Vec<f64> {
        let base = self.base.ncols();
        let all = base + 2 * waves.len();
        let matrix = |readings: &[usize]| {
            let rows = self.rows_of(readings);
            let mut matrix = DMatrix::zeros(rows.len(), all + 1);
            let columns = self.base.select_rows(&rows);
            matrix.columns_mut(0, base).copy_from(&columns);
            let residual = self.residual.select_rows(&rows);
            matrix.column_mut(all).copy_from(&residual);
            for (k, wave) in waves.iter().enumerate() {
                let pair = self.pair(wave.joint, wave.cycles, readings) * TYPICAL;
                matrix.columns_mut(base + 2 * k, 2).copy_from(&pair);
            }
            matrix
        };
        let counts: Vec<usize> = (0..=waves.len()).map(|k| base + 2 * k).collect();
        let priors = vec![solve::WEAK; all];
        folds::left_out(&matrix(kept), &matrix(tested), &priors, &counts)
    }

    fn rows_of(&self, readings: &[usize]) -> Vec<usize> {
        let rows = readings.iter().map(|&i| self.rows[i]..self.rows[i + 1]);
        rows.flatten().collect()
    }

    /// `g sin N q`, `g cos N q` by rows of these readings.
    fn pair(&self, joint: usize, cycles: f64, readings: &[usize]) -> DMatrix<f64> {
        let joint = &self.joints[joint];
        let count = readings.iter().map(|&i| self.rows[i + 1] - self.rows[i]);
        let mut pair = DMatrix::zeros(count.sum(), 2);
        let mut row = 0;
        for &i in readings {
            let (sin, cos) = (cycles * joint.angles[i]).sin_cos();
            for value in joint
                .motion
                .rows(self.rows[i], self.rows[i + 1] - self.rows[i])
                .iter()
            {
                pair[(row, 0)] = value * sin;
                pair[(row, 1)] = value * cos;
                row += 1;
            }
        }
        pair
    }
}

/// A wave as the search knows it.
#[derive(Debug, Clone)]
struct Peak {
    joint: usize,
    cycles: f64,
    p_value: f64,
    also: Vec<f64>,
}

/// Rows of one joint summed over readings at the same angle, and the frequencies to try.
struct Lane {
    /// Different angles, rad.
    angles: Vec<f64>,
    /// Place of each reading's angle among them.
    place: Vec<usize>,
    /// Squared motion at each.
    weight: Vec<f64>,
    /// Products of motion and basis, angles by directions: only their products with each other count.
    basis: DMatrix<f64>,
    /// Products of motion and residual.
    residual: DMatrix<f64>,
    /// Period over the range, cycles a turn.
    period: f64,
    /// Least frequency, step and number of them.
    first: f64,
    step: f64,
    count: usize,
    /// By frequency.
    moments: Vec<Moments>,
    /// Directions of the basis that the moments know of.
    done: usize,
    /// Independent frequencies.
    trials: f64,
}

/// Products of a pair's columns with each other and with the residual, the basis partialled out.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    ss: f64,
    sc: f64,
    cc: f64,
    sr: f64,
    cr: f64,
}

impl Moments {
    /// Score of the pair over the noise variance, zero if one of its directions is faint.
    fn chi2(&self, variance: f64) -> f64 {
        let mean = 0.5 * (self.ss + self.cc);
        // sizes near one: no need of the slower `hypot`
        let spread = (0.25 * (self.ss - self.cc).powi(2) + self.sc.powi(2)).sqrt();
        let weaker = mean - spread;
        if weaker * TYPICAL.powi(2) <= FAINT.powi(2) * variance {
            return 0.0;
        }
        let determinant = (mean + spread) * weaker;
        let squares = self.cc * self.sr.powi(2) - 2.0 * self.sc * self.sr * self.cr
            + self.ss * self.cr.powi(2);
        squares / determinant / variance
    }
}

impl Lane {
    fn frequency(&self, place: usize) -> f64 {
        self.first + self.step * place as f64
    }

    /// Takes the directions that are new out of all moments, and the residual's products anew.
    fn update(&mut self) {
        let batches: Vec<Range<usize>> = (0..self.count)
            .step_by(BATCH)
            .map(|begin| begin..(begin + BATCH).min(self.count))
            .collect();
        let lane = &*self;
        let directions = self
            .basis
            .columns(self.done, self.basis.ncols() - self.done);
        let directions = directions.into_owned();
        let moments: Vec<Vec<Moments>> = batches
            .into_par_iter()
            .map(|batch| lane.batch(batch, &directions))
            .collect();
        self.moments = moments.concat();
        self.done = self.basis.ncols();
    }

    fn batch(&self, batch: Range<usize>, directions: &DMatrix<f64>) -> Vec<Moments> {
        let mut sin = DMatrix::zeros(batch.len(), self.angles.len());
        let mut cos = sin.clone();
        for (k, &q) in self.angles.iter().enumerate() {
            // the next frequency by turning the last: exact to rounding over a batch
            let (mut s, mut c) = (self.frequency(batch.start) * q).sin_cos();
            let (turn_s, turn_c) = (self.step * q).sin_cos();
            for i in 0..batch.len() {
                sin[(i, k)] = s;
                cos[(i, k)] = c;
                (s, c) = (s * turn_c + c * turn_s, c * turn_c - s * turn_s);
            }
        }
        let (along_s, along_c) = (&sin * directions, &cos * directions);
        let (sr, cr) = (&sin * &self.residual, &cos * &self.residual);
        let fresh = self.moments.is_empty();
        let mut found: Vec<Moments> = if fresh {
            vec![Moments::default(); batch.len()]
        } else {
            self.moments[batch].to_vec()
        };
        if fresh {
            for (k, &weight) in self.weight.iter().enumerate() {
                for (i, m) in found.iter_mut().enumerate() {
                    let (s, c) = (sin[(i, k)], cos[(i, k)]);
                    m.ss += weight * s * s;
                    m.sc += weight * s * c;
                    m.cc += weight * c * c;
                }
            }
        }
        for k in 0..directions.ncols() {
            for (i, m) in found.iter_mut().enumerate() {
                let (s, c) = (along_s[(i, k)], along_c[(i, k)]);
                m.ss -= s * s;
                m.sc -= s * c;
                m.cc -= c * c;
            }
        }
        for (i, m) in found.iter_mut().enumerate() {
            (m.sr, m.cr) = (sr[i], cr[i]);
        }
        found
    }

    /// The moments at any number of cycles.
    fn at(&self, cycles: f64) -> Moments {
        let waves = self.angles.iter().map(|q| (cycles * q).sin_cos());
        let (sin, cos): (Vec<f64>, Vec<f64>) = waves.unzip();
        let (sin, cos) = (DVector::from_vec(sin), DVector::from_vec(cos));
        let (along_s, along_c) = (self.basis.tr_mul(&sin), self.basis.tr_mul(&cos));
        let weighted = |a: &DVector<f64>, b: &DVector<f64>| -> f64 {
            let terms = self.weight.iter().zip(a.iter().zip(b.iter()));
            terms.map(|(w, (a, b))| w * a * b).sum()
        };
        Moments {
            ss: weighted(&sin, &sin) - along_s.norm_squared(),
            sc: weighted(&sin, &cos) - along_s.dot(&along_c),
            cc: weighted(&cos, &cos) - along_c.norm_squared(),
            sr: sin.dot(&self.residual.column(0)),
            cr: cos.dot(&self.residual.column(0)),
        }
    }
}

/// A search on some of the readings.
struct Search<'a> {
    scan: &'a Scan,
    readings: Vec<usize>,
    /// Orthonormal: what the base model and the waves found can do.
    basis: Columns,
    /// Directions of it that are the base model's.
    rank: usize,
    /// What they leave, and what the base model alone leaves.
    residual: DVector<f64>,
    of_base: DVector<f64>,
    /// By joints of the scan; none with too few angles.
    lanes: Vec<Option<Lane>>,
    against: Against,
    /// Independent frequencies of all joints.
    trials: f64,
    found: Vec<Peak>,
}

impl<'a> Search<'a> {
    fn new(scan: &'a Scan, readings: &[usize], against: Against) -> Self {
        let rows = scan.rows_of(readings);
        let basis = orthonormal(&scan.base.select_rows(&rows));
        let mut residual = scan.residual.select_rows(&rows);
        residual -= &basis * basis.tr_mul(&residual);
        let mut search = Self {
            scan,
            readings: readings.to_vec(),
            rank: basis.ncols(),
            basis: Columns::of(basis),
            of_base: residual.clone(),
            residual,
            lanes: Vec::new(),
            against,
            trials: 0.0,
            found: Vec::new(),
        };
        search.settle_noise();
        let lanes = (0..scan.joints.len()).into_par_iter();
        search.lanes = lanes.map(|joint| search.lane(joint)).collect();
        search.trials = search.lanes.iter().flatten().map(|lane| lane.trials).sum();
        search
    }

    /// Where nothing else says how large the noise is, it is what is left.
    fn settle_noise(&mut self) {
        if self.scan.own_noise {
            let dof = self.residual.len().saturating_sub(self.basis.all().ncols());
            let dof = dof.max(1) as f64;
            self.against = Against {
                variance: self.residual.norm_squared() / dof,
                dof: Some(dof),
            };
        }
    }

    fn lane(&self, joint: usize) -> Option<Lane> {
        let turning = &self.scan.joints[joint];
        let mut angles: Vec<f64> = self.readings.iter().map(|&i| turning.angles[i]).collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup();
        if angles.len() < ANGLES {
            return None;
        }
        let of = |&i: &usize| angles.partition_point(|&angle| angle < turning.angles[i]);
        let place: Vec<usize> = self.readings.iter().map(of).collect();
        let mut weight = vec![0.0; angles.len()];
        self.each_row(joint, &place, |place, _, motion| {
            weight[place] += motion * motion;
        });
        let period = TAU / (angles[angles.len() - 1] - angles[0]);
        let (first, step) = (SLOWEST + period, period / STEPS);
        let mut lane = Lane {
            weight,
            basis: compact(self.products(joint, &place, self.basis.all())),
            residual: self.products(joint, &place, column(&self.residual)),
            count: ((FASTEST - first) / step).max(0.0) as usize,
            angles,
            place,
            period,
            first,
            step,
            moments: Vec::new(),
            done: 0,
            trials: 0.0,
        };
        let all: f64 = lane.weight.iter().sum();
        if all <= 0.0 || lane.count == 0 {
            return None;
        }
        let mean = |of: &dyn Fn(f64) -> f64| {
            let terms = lane.angles.iter().zip(&lane.weight);
            terms.map(|(&q, w)| w * of(q)).sum::<f64>() / all
        };
        let centre = mean(&|q| q);
        let variance = mean(&|q| (q - centre).powi(2));
        lane.trials = lane.count as f64 * lane.step * (4.0 * PI * variance).sqrt() / TAU;
        lane.update();
        Some(lane)
    }

    /// Calls with the place of the angle, the row and the motion, for each row of the readings.
    fn each_row(&self, joint: usize, places: &[usize], mut then: impl FnMut(usize, usize, f64)) {
        let scan = self.scan;
        let mut row = 0;
        for (&reading, &place) in self.readings.iter().zip(places) {
            for source in scan.rows[reading]..scan.rows[reading + 1] {
                then(place, row, scan.joints[joint].motion[source]);
                row += 1;
            }
        }
    }

    /// Products of a joint's motion with columns over the rows, summed by angle.
    fn products(
        &self,
        joint: usize,
        places: &[usize],
        columns: DMatrixView<'_, f64>,
    ) -> DMatrix<f64> {
        let angles = places.iter().max().map_or(0, |last| last + 1);
        let mut sums = DMatrix::zeros(angles, columns.ncols());
        let motion = self.scan.joints[joint].motion.as_slice();
        for (mut sums, column) in sums.column_iter_mut().zip(columns.column_iter()) {
            let mut row = 0;
            for (&reading, &place) in self.readings.iter().zip(places) {
                let own = &motion[self.scan.rows[reading]..self.scan.rows[reading + 1]];
                let column = column.rows(row, own.len());
                sums[place] += own.iter().zip(&column).map(|(a, b)| a * b).sum::<f64>();
                row += own.len();
            }
        }
        sums
    }

    /// By joint: the height of the pair that stands highest over its frequencies, and its place.
    fn heights(&self) -> Vec<Option<(f64, usize)>> {
        let variance = self.against.variance;
        let of = |(joint, lane): (usize, &Option<Lane>)| {
            let lane = lane.as_ref()?;
            let mut best: Option<(f64, usize)> = None;
            for (place, moments) in lane.moments.iter().enumerate() {
                let chi2 = moments.chi2(variance);
                if best.is_none_or(|b| chi2 > b.0) && self.is_free(joint, lane.frequency(place)) {
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
        let middle = lane.frequency(place);
        let (cycles, chi2) = highest(middle - lane.step, middle + lane.step, |cycles| {
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
        let known = self.scan.joints[joint].known.iter().copied();
        here.map(|peak| peak.cycles)
            .chain(known)
            .all(|other| (other - cycles).abs() >= APART * lane.period)
    }

    /// Other frequencies of the joint at which the readings are explained as well.
    fn rivals(&self, lane: &Lane, cycles: f64, chi2: f64) -> Vec<f64> {
        let heights: Vec<f64> = lane
            .moments
            .iter()
            .map(|moments| moments.chi2(self.against.variance))
            .collect();
        let is_peak = |&place: &usize| {
            let near = &heights[place.saturating_sub(1)..(place + 2).min(heights.len())];
            heights[place] > chi2 - 2.0 * NEAR
                && near.iter().all(|&other| other <= heights[place])
                && (lane.frequency(place) - cycles).abs() >= lane.period
        };
        let peaks = (0..heights.len()).filter(is_peak);
        peaks.map(|place| lane.frequency(place)).collect()
    }

    /// Leaves the first waves alone.
    fn truncate(&mut self, keep: usize) {
        self.found.truncate(keep);
        let pairs = self.pairs();
        let (_, left) = self.amplitudes(&pairs);
        if self.scan.own_noise {
            let dof = self.residual.len().saturating_sub(self.rank + 2 * keep);
            self.against.variance = left / dof.max(1) as f64;
        }
    }

    /// Takes up waves until none is sure, or there are `most`. Between two scans each joint has its turn, the
    /// strongest first: waves of different joints are nearly independent, and each is judged beside those taken.
    fn grow(&mut self, alarm: f64, most: usize) {
        loop {
            let mut joints = vec![true; self.lanes.len()];
            let before = self.found.len();
            let mut heights = self.heights();
            while self.found.len() < most {
                if self.scan.own_noise && self.found.len() > before {
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
            self.rescan();
        }
    }

    /// Takes up a wave: it joins the basis.
    fn take(&mut self, peak: Peak) {
        let mut pair = self.scan.pair(peak.joint, peak.cycles, &self.readings);
        // twice: once leaves rounding of what was large
        for _ in 0..2 {
            pair -= self.basis.all() * self.basis.all().tr_mul(&pair);
        }
        let fresh = pair.qr().q();
        self.residual -= &fresh * fresh.tr_mul(&self.residual);
        self.basis.push(&fresh);
        self.found.push(peak);
        self.settle_noise();
        let mut lanes = std::mem::take(&mut self.lanes);
        let here = &*self;
        let residual = column(&here.residual);
        lanes.par_iter_mut().enumerate().for_each(|(joint, lane)| {
            let Some(lane) = lane else { return };
            lane.residual = here.products(joint, &lane.place, residual);
            append(
                &mut lane.basis,
                &here.products(joint, &lane.place, fresh.as_view()),
            );
        });
        self.lanes = lanes;
    }

    /// Brings the moments of all frequencies up to the basis.
    fn rescan(&mut self) {
        for lane in self.lanes.iter_mut().flatten() {
            lane.update();
        }
    }

    /// Columns with what the base model can do taken out.
    fn partialled(&self, columns: DMatrix<f64>) -> DMatrix<f64> {
        let all = self.basis.all();
        let base = all.columns(0, self.rank);
        &columns - base * (base.transpose() * &columns)
    }

    /// All pairs by rows, base model partialled out.
    fn pairs(&self) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(self.residual.len(), 2 * self.found.len());
        for (k, peak) in self.found.iter().enumerate() {
            let pair = self.scan.pair(peak.joint, peak.cycles, &self.readings);
            all.columns_mut(2 * k, 2).copy_from(&pair);
        }
        self.partialled(all)
    }

    /// What moves when the cycles do: derivative of each wave by its own.
    fn rates(&self, amplitudes: &DVector<f64>) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(self.residual.len(), self.found.len());
        for (k, peak) in self.found.iter().enumerate() {
            let Some(lane) = &self.lanes[peak.joint] else {
                continue;
            };
            let (a, b) = (amplitudes[2 * k], amplitudes[2 * k + 1]);
            // from the middle of the angles: a shift of it is only another phase
            let middle = 0.5 * (lane.angles[0] + lane.angles[lane.angles.len() - 1]);
            self.each_row(peak.joint, &lane.place, |place, row, motion| {
                let q = lane.angles[place];
                let (sin, cos) = (peak.cycles * q).sin_cos();
                all[(row, k)] = motion * (q - middle) * (a * cos - b * sin);
            });
        }
        self.partialled(all)
    }

    /// Period over a joint's range, cycles a turn.
    fn period(&self, joint: usize) -> f64 {
        self.lanes[joint].as_ref().map_or(0.0, |lane| lane.period)
    }

    /// Amplitudes of all waves together, rad, and what they leave of the misfit.
    fn amplitudes(&self, pairs: &DMatrix<f64>) -> (DVector<f64>, f64) {
        let right = pairs.tr_mul(&self.of_base);
        let found = Cholesky::new(pairs.transpose() * pairs).map(|c| c.solve(&right));
        let found = found.unwrap_or_else(|| DVector::zeros(right.len()));
        let left = (&self.of_base - pairs * &found).norm_squared();
        (found, left)
    }

    /// Refines all cycles together; amplitudes (rad) and one standard deviation of the cycles.
    fn refine(&mut self) -> (DVector<f64>, Vec<f64>) {
        let count = self.found.len();
        let mut pairs = self.pairs();
        let (mut amplitudes, mut left) = self.amplitudes(&pairs);
        let mut deviations = vec![f64::INFINITY; count];
        let peaks: Vec<f64> = self.found.iter().map(|peak| peak.cycles).collect();
        for _ in 0..REFINEMENTS {
            let rates = self.rates(&amplitudes);
            // rates with the pairs partialled out as well: the normal equations of the cycles alone
            let inner = Cholesky::new(pairs.transpose() * &pairs);
            let Some(inner) = inner else { break };
            let rates = &rates - &pairs * inner.solve(&(pairs.transpose() * &rates));
            let mut normal = rates.transpose() * &rates;
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
            let step = normal.solve(&rates.tr_mul(&self.of_base));
            let before: Vec<f64> = self.found.iter().map(|peak| peak.cycles).collect();
            let periods: Vec<f64> = self.found.iter().map(|p| self.period(p.joint)).collect();
            for (k, peak) in self.found.iter_mut().enumerate() {
                let most = 0.5 * periods[k] / STEPS;
                let here = peak.cycles + step[k].clamp(-most, most);
                // waves that met would only beat with each other
                peak.cycles = here.clamp(peaks[k] - 2.0 * most, peaks[k] + 2.0 * most);
            }
            let moved = self.pairs();
            let (next, reached) = self.amplitudes(&moved);
            if reached >= left {
                for (peak, cycles) in self.found.iter_mut().zip(before) {
                    peak.cycles = cycles;
                }
                break;
            }
            let settled = left - reached < 1e-3 * self.against.variance;
            (pairs, amplitudes, left) = (moved, next, reached);
            if settled {
                break;
            }
        }
        for (peak, deviation) in self.found.iter_mut().zip(&deviations) {
            peak.cycles = rounded(peak.cycles, *deviation);
        }
        (self.amplitudes(&self.pairs()).0, deviations)
    }
}

fn column(vector: &DVector<f64>) -> DMatrixView<'_, f64> {
    DMatrixView::from_slice(vector.as_slice(), vector.len(), 1)
}

/// Columns to which others come: of many rows it would be slow to copy all for each.
struct Columns {
    rows: usize,
    values: Vec<f64>,
}

impl Columns {
    fn of(matrix: DMatrix<f64>) -> Self {
        Self {
            rows: matrix.nrows(),
            values: matrix.data.into(),
        }
    }

    fn all(&self) -> DMatrixView<'_, f64> {
        let count = self.values.len() / self.rows.max(1);
        DMatrixView::from_slice(&self.values, self.rows, count)
    }

    fn push(&mut self, more: &DMatrix<f64>) {
        self.values.extend_from_slice(more.as_slice());
    }
}

/// As few columns with the same products of rows with each other.
fn compact(columns: DMatrix<f64>) -> DMatrix<f64> {
    if columns.ncols() <= columns.nrows() {
        return columns;
    }
    triangle(columns.transpose()).transpose()
}

/// Columns behind columns.
fn append(matrix: &mut DMatrix<f64>, more: &DMatrix<f64>) {
    let before = matrix.ncols();
    matrix.resize_horizontally_mut(before + more.ncols(), 0.0);
    matrix.columns_mut(before, more.ncols()).copy_from(more);
}

/// Orthonormal columns that span the directions of a matrix that count.
fn orthonormal(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = (columns.transpose() * columns).symmetric_eigen();
    let counts = |&k: &usize| eigen.eigenvalues[k].max(0.0).sqrt() >= solve::WEAK;
    let kept: Vec<usize> = (0..columns.ncols()).filter(counts).collect();
    let mut root = eigen.eigenvectors.select_columns(&kept);
    for (column, &k) in kept.iter().enumerate() {
        root.column_mut(column)
            .scale_mut(1.0 / eigen.eigenvalues[k].sqrt());
    }
    columns * root
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
