//! What a stop is worth: means of its samples, and how these scatter.

use nalgebra::{Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3};

/// A sample this many times as far from the median as half of them is an outlier: 7.7 σ of a coordinate's normal noise.
const OUTLIER: f64 = 5.0;

/// A mean with the standard deviation of one sample, a coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean<T> {
    /// The mean.
    pub mean: T,
    /// Of a sample, in its unit, root mean square over the coordinates; zero of a single one.
    pub scatter: f64,
}

/// Samples that are not outliers, by index.
pub fn inliers(points: &[Vector3<f64>]) -> Vec<usize> {
    let median = Vector3::from_fn(|axis, _| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        super::stream::quantile(&mut values, 0.5).unwrap_or(0.0)
    });
    let distances: Vec<f64> = points.iter().map(|p| (p - median).norm()).collect();
    let half = super::stream::quantile(&mut distances.clone(), 0.5).unwrap_or(0.0);
    // numbers that repeat have no distance: rounding must not make outliers of the rest
    let bound = (OUTLIER * half).max(1e-6);
    (0..points.len())
        .filter(|k| distances[*k] <= bound)
        .collect()
}

/// Mean of points (m), or forces (N).
pub fn points(points: &[Vector3<f64>]) -> Mean<Vector3<f64>> {
    let n = points.len().max(1) as f64;
    let mean = points.iter().sum::<Vector3<f64>>() / n;
    let squares: f64 = points.iter().map(|p| (p - mean).norm_squared()).sum();
    Mean {
        mean,
        scatter: (squares / (3.0 * (n - 1.0).max(1.0))).sqrt(),
    }
}

/// Mean of joints, rad (m).
pub fn joints(samples: &[Vec<f64>]) -> Mean<Vec<f64>> {
    let count = samples.first().map_or(0, Vec::len);
    let n = samples.len().max(1) as f64;
    let mean: Vec<f64> = (0..count)
        .map(|j| samples.iter().map(|q| q[j]).sum::<f64>() / n)
        .collect();
    let squares: f64 = samples
        .iter()
        .flat_map(|q| q.iter().zip(&mean).map(|(q, mean)| (q - mean).powi(2)))
        .sum();
    Mean {
        mean,
        scatter: (squares / (count.max(1) as f64 * (n - 1.0).max(1.0))).sqrt(),
    }
}

/// Mean of rotations: the eigenvector of Σ q qᵀ of the largest eigenvalue, which minimises the squared distances of the
/// rotation matrices and does not see the sign of a quaternion. Scatter in rad.
///
/// Source: Markley, Cheng, Crassidis & Oshman 2007, Averaging quaternions, eq. 12.
pub fn rotations(samples: &[UnitQuaternion<f64>]) -> Option<Mean<UnitQuaternion<f64>>> {
    let mut sum = Matrix4::zeros();
    for q in samples {
        sum += q.coords * q.coords.transpose();
    }
    let eigen = SymmetricEigen::new(sum / samples.len().max(1) as f64);
    let largest = eigen.eigenvalues.imax();
    let vector = eigen.eigenvectors.column(largest).into_owned();
    let mut mean = UnitQuaternion::try_new(Quaternion::from(vector), 1e-6)?;
    // of the two signs the one of the first sample
    if samples
        .first()
        .is_some_and(|q| q.coords.dot(&mean.coords) < 0.0)
    {
        mean = UnitQuaternion::new_unchecked(-mean.into_inner());
    }
    let squares: f64 = samples.iter().map(|q| mean.angle_to(q).powi(2)).sum();
    let free = 3.0 * (samples.len() as f64 - 1.0).max(1.0);
    Some(Mean {
        mean,
        scatter: (squares / free).sqrt(),
    })
}
