//! The offset of a stream's clock from that of the joints: given, estimated, or what the log times say.

use super::clock::{self, ClockReport, Offset, Path, Status};
use super::stream::Series;
use super::{Import, Spec};
use nalgebra::Vector3;

/// The offset of a stream: given, estimated, or what the log times say. Reported.
pub(super) fn offset(
    (role, topic): (&str, &str),
    (path, lever): (&Path, Vector3<f64>),
    measured: &Series<Vector3<f64>>,
    (given, by_log): (Option<f64>, f64),
    spec: &Spec,
    import: &mut Import,
) -> Offset {
    let estimate = clock::estimate(path, measured, lever, spec.clock.max_offset_s);
    let still = Offset {
        offset: 0.0,
        drift: 0.0,
        middle: 0.0,
    };
    let mut report = ClockReport {
        role: format!("{role}, {topic}"),
        status: Status::Unknown,
        offset_s: by_log,
        std_s: None,
        by_log_times_s: by_log,
        correlation: None,
        next_correlation: None,
        drift: None,
        drift_std: None,
        drift_applied: false,
        scale: None,
        why: None,
    };
    let mut used = still.clone();
    match estimate {
        Ok(found) => {
            report.status = Status::Estimated;
            report.offset_s = by_log + found.offset.offset;
            report.std_s = found.std;
            report.correlation = Some(found.correlation);
            report.next_correlation = Some(found.next);
            report.drift = found.drift.map(|d| d.0);
            report.drift_std = found.drift.map(|d| d.1);
            report.drift_applied = found.offset.drift != 0.0;
            report.scale = Some(found.scale);
            used = found.offset;
        }
        Err(unknown) => {
            report.correlation = unknown.correlations.map(|c| c.0);
            report.next_correlation = unknown.correlations.map(|c| c.1);
            report.why = Some(unknown.why);
        }
    }
    if let Some(given) = given {
        if report.status == Status::Estimated && (report.offset_s - given).abs() > 0.05 {
            import.warnings.push(format!(
                "{topic}: the motion says {:+.4} s where the spec gives {given:+.4} s, which is used",
                report.offset_s
            ));
        }
        report.status = Status::Given;
        report.offset_s = given;
        report.std_s = None;
        report.drift_applied = false;
        used = Offset {
            offset: given - by_log,
            ..still
        };
    }
    import.clocks.push(report);
    used
}

pub(super) fn shift(times: &mut [f64], offset: &Offset) {
    for time in times {
        *time = offset.joints_time(*time);
    }
}
