//! Observability indices: one number for how well readings fix all parameters together.
//!
//! `s₁ ≥ … ≥ s_L` are the singular values of the whitened Jacobian with columns in typical sizes, `m` its rows. Only
//! directions that count (`s` of `WEAK` and more) take part: with gauge freedoms, as between geometry and
//! frames, all indices would otherwise be zero or rounding. Indices of different `L` do not compare: of two designs the
//! one that fixes more directions would look worse for the weakest of them. So designs are compared over the strongest
//! directions of each, as many as all of them fix.
//!
//! | index | | source |
//! |---|---|---|
//! | O1 | `(s₁ … s_L)^(1/L) / √m` | Borm, Menq 1991, Int. J. Robotics Research 10(1) |
//! | O2 | `s_L / s₁` | Driels, Pathre 1990, J. Robotic Systems 7(2) |
//! | O3 | `s_L` | Nahvi, Hollerbach, Hayward 1994, ICRA |
//! | O4 | `s_L² / s₁` | Nahvi, Hollerbach 1996, ICRA (noise amplification index) |
//! | O5 | `1 / Σ 1/s` | Sun, Hollerbach 2008, ICRA |

use crate::fit::solve::WEAK;
use nalgebra::DMatrix;

/// The five indices.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Observability {
    /// Geometric mean of the singular values over the root of the number of rows.
    pub o1: f64,
    /// Inverse condition number.
    pub o2: f64,
    /// Smallest singular value.
    pub o3: f64,
    /// Noise amplification index.
    pub o4: f64,
    /// Inverse of the sum of the standard deviations along the singular directions.
    pub o5: f64,
    /// Directions that count.
    pub directions: usize,
    /// The strongest of them, over which the indices are taken.
    pub over: usize,
}

/// The indices of an information matrix `JᵀJ` from so many rows over its `most` strongest directions at most; all zero
/// if no direction counts.
pub fn indices(information: &DMatrix<f64>, rows: usize, most: usize) -> Observability {
    let eigen = information.clone().symmetric_eigenvalues();
    let mut values: Vec<f64> = eigen.iter().map(|value| value.max(0.0).sqrt()).collect();
    values.retain(|&s| s >= WEAK);
    values.sort_by(|a, b| b.total_cmp(a));
    let directions = values.len();
    values.truncate(most);
    let (Some(&first), Some(&last)) = (values.first(), values.last()) else {
        return Observability {
            o1: 0.0,
            o2: 0.0,
            o3: 0.0,
            o4: 0.0,
            o5: 0.0,
            directions,
            over: 0,
        };
    };
    let count = values.len() as f64;
    let mean_log = values.iter().map(|s| s.ln()).sum::<f64>() / count;
    Observability {
        o1: mean_log.exp() / (rows as f64).sqrt(),
        o2: last / first,
        o3: last,
        o4: last * last / first,
        o5: 1.0 / values.iter().map(|s| 1.0 / s).sum::<f64>(),
        directions,
        over: values.len(),
    }
}
