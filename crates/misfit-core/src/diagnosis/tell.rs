//! Is there a fit that tests can be asked of?

use crate::effects::Role;
use crate::fit::{Fit, Status};

/// What decides it, as plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facts {
    /// Did the fit converge?
    pub converged: bool,
    /// Position error of the fit over that of the frames alone, whose parameters it has too.
    pub over_frames: f64,
    /// Rows fitted.
    pub rows: usize,
    /// Directions of the parameters that they fix.
    pub directions: usize,
    /// Springs at their bound, and all that loads could show.
    pub at_bound: (usize, usize),
}

/// Rows beyond the directions without which no test has a noise to compare with.
const MIN_ROWS_LEFT: usize = 4;
/// A fit is worse than frames alone from this ratio of errors on.
const WORSE: f64 = 1.05;

/// Why nothing can be told; none if there is a fit.
pub fn cannot_tell(facts: &Facts) -> Option<String> {
    let left = facts.rows.saturating_sub(facts.directions);
    if left < MIN_ROWS_LEFT {
        return Some(format!(
            "{} rows are taken by {} directions of the model: measure more poses, or take a smaller model",
            facts.rows, facts.directions
        ));
    }
    if !facts.converged {
        return Some("the fit did not converge: nothing about its residuals means anything".into());
    }
    if facts.over_frames > WORSE {
        return Some(format!(
            "the fit is worse than that of the frames alone, {:.2} times their error: it ended in a wrong place",
            facts.over_frames
        ));
    }
    let (bound, all) = facts.at_bound;
    if all > 1 && bound == all {
        return Some(
            "all springs are at zero: they would be negative, so the sign of gravity, payload or wrench is reversed, \
             or the loads are not those that the table says"
                .into(),
        );
    }
    None
}

/// The facts of a fit; `frames` is the position error of the frames alone, m.
pub fn facts(fit: &Fit, rows: usize, frames: f64) -> Facts {
    let springs = fit.model.term_of(Role::Spring).map_or((0, 0), |term| {
        let own = term.first..term.first + term.parameters.len();
        let count = |status: Status| own.clone().filter(|&k| fit.status[k] == status).count();
        let bound = count(Status::AtBound);
        (bound, bound + count(Status::Estimated))
    });
    Facts {
        converged: fit.converged,
        over_frames: fit.fit.position_rms_m / frames.max(f64::MIN_POSITIVE),
        rows,
        directions: fit.rank,
        at_bound: springs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_of_having_no_fit_is_told() {
        let good = Facts {
            converged: true,
            over_frames: 0.1,
            rows: 100,
            directions: 40,
            at_bound: (0, 6),
        };
        assert_eq!(cannot_tell(&good), None);
        for (facts, word) in [
            (
                Facts {
                    converged: false,
                    ..good
                },
                "converge",
            ),
            (
                Facts {
                    over_frames: 1.06,
                    ..good
                },
                "worse",
            ),
            (
                Facts {
                    directions: 97,
                    ..good
                },
                "rows",
            ),
            (
                Facts {
                    directions: 120,
                    ..good
                },
                "rows",
            ),
            (
                Facts {
                    at_bound: (6, 6),
                    ..good
                },
                "negative",
            ),
            (
                Facts {
                    at_bound: (2, 2),
                    ..good
                },
                "negative",
            ),
        ] {
            let why = cannot_tell(&facts).unwrap_or_default();
            assert!(why.contains(word), "{facts:?}: {why}");
        }
        for facts in [
            Facts {
                over_frames: 1.04,
                ..good
            },
            Facts {
                directions: 96,
                ..good
            },
            Facts {
                at_bound: (5, 6),
                ..good
            },
            Facts {
                at_bound: (1, 1),
                ..good
            },
            Facts {
                at_bound: (0, 0),
                ..good
            },
        ] {
            assert_eq!(cannot_tell(&facts), None, "{facts:?}");
        }
    }
}
