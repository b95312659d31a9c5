//! Blocks of rows that need another frame: the tracker, or the robot's base, was set up anew.

use super::table::{FramesAlone, Table, quantile};
use crate::robot::Robot;

/// Rows that a frame is first found from.
const FIRST: usize = 12;
/// Rows off a frame, one after the other, after which another begins.
const RUN: usize = 3;
/// A row is off a frame from this size on: so many times the middle, and at least this share of the spread.
const OFF: (f64, f64) = (8.0, 0.02);
/// More blocks than this are no set-ups.
const MAX_BLOCKS: usize = 8;

/// First rows of blocks of one frame each, if the whole table is made of at least two of them; each agrees to `agrees`.
pub fn blocks(robot: &Robot, table: &Table, agrees: f64) -> Option<Vec<usize>> {
    let mut starts = Vec::new();
    let mut first = 0;
    while first + FIRST <= table.len() {
        if starts.len() == MAX_BLOCKS {
            return None;
        }
        starts.push(first);
        let mut known = FIRST;
        loop {
            let rows: Vec<usize> = (first..(first + known).min(table.len())).collect();
            let fit = FramesAlone::fit(robot, &table.select(&rows), 40);
            if fit.misfit() > agrees {
                return None;
            }
            let rest: Vec<usize> = (first..table.len()).collect();
            let sizes = fit.sizes_of(robot, &table.select(&rest));
            let limit = OFF.1.max(OFF.0 * quantile(&sizes[..rows.len()], 0.5));
            let reached = run(&sizes, limit);
            let end = (2 * known).min(table.len() - first);
            if reached < end || end == table.len() - first {
                first += reached;
                break;
            }
            known = end;
        }
    }
    (starts.len() > 1 && first >= table.len()).then_some(starts)
}

/// How many sizes come before several beyond the limit, one after the other.
fn run(sizes: &[f64], limit: f64) -> usize {
    sizes
        .windows(RUN)
        .position(|window| window.iter().all(|size| *size > limit))
        .unwrap_or(sizes.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_blunders_end_no_block() {
        let mut sizes = vec![0.1; 20];
        assert_eq!(run(&sizes, 1.0), 20);
        sizes[4] = 5.0;
        sizes[5] = 5.0;
        assert_eq!(run(&sizes, 1.0), 20);
        sizes[12..].fill(2.0);
        assert_eq!(run(&sizes, 1.0), 12);
    }
}
