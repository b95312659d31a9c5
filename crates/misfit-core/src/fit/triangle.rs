//! The upper triangular factor of a tall matrix: Householder reflections, sixteen columns at a time.
//!
//! `A = Q R` with `Q` left unformed. Within a panel reflections are applied one by one; all columns behind it are then
//! moved by two products of matrices, `C -= V (Tᵀ (Vᵀ C))`, which run from the cache several times as fast as one
//! reflection after the other, and are as accurate.
//!
//! Source: Schreiber, Van Loan 1989, *A storage-efficient WY representation for products of Householder
//! transformations*, SIAM J. Sci. Stat. Comput. 10, 53; Golub, Van Loan 2013, *Matrix Computations*, 5.2.3.

use nalgebra::DMatrix;

/// Columns a panel.
const PANEL: usize = 16;

/// The upper triangular factor; matrices with fewer rows than columns are small enough as they are.
pub fn triangle(mut matrix: DMatrix<f64>) -> DMatrix<f64> {
    let (rows, columns) = matrix.shape();
    if rows < columns {
        return matrix;
    }
    let mut first = 0;
    while first < columns {
        let width = PANEL.min(columns - first);
        let (mirrors, factors) = panel(&mut matrix, first, width);
        let behind = columns - first - width;
        if behind > 0 {
            let turned = mirrors.transpose();
            let mut below = matrix.view_mut((first, first + width), (rows - first, behind));
            let along = &turned * &below;
            let weights = factors.tr_mul(&along);
            below.gemm(-1.0, &mirrors, &weights, 1.0);
        }
        first += width;
    }
    let mut factor = matrix.resize_vertically(columns, 0.0);
    factor.fill_lower_triangle(0.0, 1);
    factor
}

/// Reduces the columns of a panel; `V` (unit lower trapezoid) and the upper triangular `T` of their reflections,
/// `H₁ H₂ … = 1 - V T Vᵀ`.
fn panel(matrix: &mut DMatrix<f64>, first: usize, width: usize) -> (DMatrix<f64>, DMatrix<f64>) {
    let rows = matrix.nrows() - first;
    let mut mirrors = DMatrix::zeros(rows, width);
    let mut factors = DMatrix::zeros(width, width);
    for k in 0..width {
        let column = matrix.column(first + k);
        let own = column.rows(first + k, rows - k);
        let length = own.norm();
        if length == 0.0 {
            // nothing to reflect
            mirrors[(k, k)] = 1.0;
            continue;
        }
        let head = own[0];
        // away from the head, so that nothing cancels
        let reached = if head > 0.0 { -length } else { length };
        let pivot = head - reached;
        let mut mirror = mirrors.view_mut((k, k), (rows - k, 1));
        mirror.copy_from(&own);
        mirror /= pivot;
        mirror[(0, 0)] = 1.0;
        let weight = -pivot / reached;
        let mirror = mirrors.view((k, k), (rows - k, 1));
        let mirror = mirror.column(0);
        matrix[(first + k, first + k)] = reached;
        for other in first + k + 1..first + width {
            let mut target = matrix.view_mut((first + k, other), (rows - k, 1));
            let along = mirror.dot(&target.column(0)) * weight;
            target.column_mut(0).axpy(-along, &mirror, 1.0);
        }
        // T's next column: -τ T (Vᵀ v)
        for row in 0..k {
            let along = mirrors
                .view((k, row), (rows - k, 1))
                .dot(&mirrors.view((k, k), (rows - k, 1)));
            factors[(row, k)] = along;
        }
        let across = factors.view((0, k), (k, 1)).into_owned();
        let next = factors.view((0, 0), (k, k)) * across * -weight;
        factors.view_mut((0, k), (k, 1)).copy_from(&next);
        factors[(k, k)] = weight;
    }
    (mirrors, factors)
}

#[cfg(test)]
mod tests {
    use super::triangle;
    use nalgebra::DMatrix;

    /// Columns of sizes from 1 to 1e-9, two of them alike, one zero.
    fn matrix(rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |i, k| match k {
            5 => 0.0,
            _ => {
                let k = if k == 9 { 2 } else { k };
                ((1 + i * (2 * k + 3) + k * k) as f64).sin() * 10f64.powi(-(k as i32 % 10))
            }
        })
    }

    #[test]
    fn triangle_is_that_of_nalgebra() {
        for (rows, columns) in [(1, 1), (16, 16), (17, 17), (40, 1), (95, 37), (200, 69)] {
            let matrix = matrix(rows, columns);
            let found = triangle(matrix.clone());
            let right = matrix.clone().qr().r();
            for k in 0..columns {
                // what is equal whatever the signs of the rows, to the rounding of its column's length
                let (a, b) = (found.column(k).norm(), matrix.column(k).norm());
                assert!(
                    (a - b).abs() <= 1e-14 * b * rows as f64,
                    "{rows}×{columns}, {k}"
                );
                for j in 0..columns {
                    let dot = matrix.column(j).dot(&matrix.column(k));
                    let sizes = matrix.column(j).norm() * b;
                    let error = found.column(j).dot(&found.column(k)) - dot;
                    assert!(
                        error.abs() <= 1e-14 * sizes * rows as f64,
                        "{rows}×{columns}"
                    );
                }
            }
            // the independent leading columns have one factor but for the signs of its rows
            for k in 0..columns.min(5) {
                for i in 0..=k {
                    let error = found[(i, k)].abs() - right[(i, k)].abs();
                    assert!(error.abs() <= 1e-12 * matrix.column(k).norm(), "({i}, {k})");
                }
            }
            assert!(found.shape() == (columns, columns));
            for k in 0..columns {
                assert!((k + 1..columns).all(|i| found[(i, k)] == 0.0));
            }
        }
    }

    #[test]
    fn few_rows_stay_as_they_are_and_what_is_no_number_shows() {
        let few = matrix(3, 8);
        assert_eq!(triangle(few.clone()), few);
        let mut broken = matrix(30, 20);
        broken[(7, 3)] = f64::NAN;
        assert!(triangle(broken).iter().any(|x| !x.is_finite()));
    }
}
