//! A diagnosis on the terminal, and as JSON.

use super::format::{angle, count, length, number, significant, wrap};
use super::json::NoiseDocument;
use misfit_arm::robot::JointKind;
use misfit_campaign::Campaign;
use misfit_core::diagnosis::ripple::Wave;
use misfit_core::diagnosis::{Candidate, CannotSee, Diagnosis, Power, Verdict};
use misfit_core::effects::Role;
use misfit_core::fit::Errors;
use misfit_core::plan::{Outlook, Separation};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// `misfit.diagnosis/2`.
#[derive(Debug, Serialize)]
pub struct DiagnosisDocument {
    schema: &'static str,
    verdict: Verdict,
    converged: bool,
    cannot_tell: Option<String>,
    effects: Vec<String>,
    r#where: Vec<Where>,
    contrasts: Contrasts,
    candidates: Vec<Candidate>,
    cannot_see: Vec<CannotSee>,
    power: Power,
    next_poses: Vec<BTreeMap<String, f64>>,
    noise: NoiseDocument,
    waves: Vec<Wave>,
    refused: Option<String>,
    rejected: Vec<usize>,
    base: Errors,
    base_heldout: Option<Errors>,
    fit: Errors,
    heldout: Option<Errors>,
}

/// What the misfit follows.
#[derive(Debug, Serialize)]
struct Where {
    variable: String,
    pattern: String,
    p_value: f64,
}

/// p-values of the contrasts that the design has.
#[derive(Debug, Default, Serialize)]
struct Contrasts {
    pose: Option<f64>,
    load: Option<f64>,
    direction: Option<f64>,
    time: Option<f64>,
    repeat: Option<f64>,
}

/// A variable is said to carry the misfit below this probability.
const CARRIES: f64 = 1e-4;
/// Waves of a gear shown one by one.
const WAVES: usize = 12;
/// Candidates named one by one.
const SHOWN: usize = 4;

/// The document.
pub fn document(diagnosis: &Diagnosis, next: Option<&Separation>) -> DiagnosisDocument {
    let p = |name: &str| {
        let contrast = diagnosis.contrasts.iter().find(|c| c.name == name);
        contrast.map(|c| c.p_value)
    };
    DiagnosisDocument {
        schema: "misfit.diagnosis/2",
        verdict: diagnosis.verdict,
        converged: diagnosis.fit.converged,
        cannot_tell: diagnosis.untold.clone(),
        effects: diagnosis.effects.clone(),
        r#where: diagnosis
            .patterns
            .iter()
            .map(|pattern| Where {
                variable: pattern.variable.clone(),
                pattern: pattern.words.clone(),
                p_value: pattern.p_value,
            })
            .collect(),
        contrasts: Contrasts {
            pose: p("pose"),
            load: p("load"),
            direction: p("direction"),
            time: p("time"),
            repeat: p("repeat"),
        },
        candidates: diagnosis.candidates.clone(),
        cannot_see: diagnosis.cannot_see.clone(),
        power: diagnosis.power.clone(),
        next_poses: next.map_or_else(Vec::new, |plan| poses(diagnosis, plan)),
        noise: NoiseDocument::of(&diagnosis.fit),
        waves: diagnosis.waves.clone(),
        refused: diagnosis.refused.clone(),
        rejected: diagnosis.rejected.clone(),
        base: diagnosis.base.fit,
        base_heldout: diagnosis.base.heldout,
        fit: diagnosis.fit.fit,
        heldout: diagnosis.fit.heldout,
    }
}

/// Proposed poses by column of a campaign's table: `<joint>_rad`, `<joint>_m`.
fn poses(diagnosis: &Diagnosis, plan: &Separation) -> Vec<BTreeMap<String, f64>> {
    let setup = &diagnosis.base.model.setup;
    let of = |pose: &Vec<f64>| {
        let joints = setup.observed.iter().map(|&joint| {
            let own = &setup.robot.joints[joint];
            let unit = match own.kind {
                JointKind::Prismatic => "m",
                JointKind::Revolute | JointKind::Continuous => "rad",
            };
            (format!("{}_{unit}", own.name), pose[joint])
        });
        joints.collect()
    };
    plan.poses.iter().map(of).collect()
}

/// The design, and what it can do.
fn design(power: &Power) -> String {
    let mut text = format!(
        "design   {} × {} × {} × {} · of the effects not in the model it could see {}, and tell {} of them from \
         every other",
        count(power.poses, "pose"),
        count(power.loads, "load"),
        count(power.directions, "direction"),
        count(power.repeats, "repeat"),
        power.visible,
        power.apart
    );
    let lacks = power.lacks();
    if !lacks.is_empty() && power.is_enough() {
        text += &format!(". It would see more with {}", lacks.join("; "));
    }
    let mut text = wrap(&text, 9);
    if !power.is_enough() {
        let line = format!(
            "         No diagnosis is possible: {} rows, {} of which go into the model; what is left of most \
             effects, another one could be. Needed: {}",
            power.rows,
            power.taken,
            if lacks.is_empty() {
                "more poses, heavier loads".to_owned()
            } else {
                lacks.join("; ")
            }
        );
        text += &format!("\n{}", wrap(&line, 9));
    }
    text
}

/// What the proposed poses promise, in a line or two.
fn promise(plan: &Separation) -> String {
    let mut out = String::new();
    for way in &plan.ways {
        let word = match way.outlook() {
            Outlook::Decisive => "they will tell".to_owned(),
            Outlook::Weak => format!("hardly: λ {} of 60", number(way.proposed)),
            Outlook::Unseen => "it does not show in such readings".to_owned(),
            Outlook::Never => "no poses can; `misfit effects show` says what can".to_owned(),
        };
        let line = format!(
            "next     {} more poses, if it is {} and not {}: {word}",
            plan.poses.len(),
            way.effect,
            way.other
        );
        let _ = writeln!(out, "{}", wrap(&line, 9));
    }
    out
}

/// Readings that were rejected, if any: how many, and where they stand.
pub fn rejected(diagnosis: &Diagnosis) -> Option<String> {
    match diagnosis.rejected.len() {
        0 => None,
        n => Some(format!(
            "{n} rejected (lines {})",
            lines(&diagnosis.rejected)
        )),
    }
}

/// The report.
pub fn text(campaign: &Campaign, diagnosis: &Diagnosis, next: Option<&Separation>) -> String {
    let mut out = String::new();
    let base = &diagnosis.base;
    let rejected = rejected(diagnosis).unwrap_or_else(|| "none rejected".to_owned());
    let title = format!(
        "{} · robot {} · {} · {rejected}",
        campaign.name,
        campaign.robot.name,
        count(base.readings.0, "reading")
    );
    let _ = writeln!(out, "{}", wrap(&title, 9));
    let _ = writeln!(out, "{}", super::fit::model_line(base));
    let _ = writeln!(out, "{}", super::fit::noise_line(campaign, base));
    let _ = writeln!(out, "{}", design(&diagnosis.power));
    let held = base.heldout.map_or_else(String::new, |e| {
        format!(" · not fitted {} rms", length(e.position_rms_m))
    });
    let _ = writeln!(
        out,
        "\nerror    fitted {} rms{held} · {} × noise\n",
        length(base.fit.position_rms_m),
        number((base.fit.whitened_rms.powi(2) / base.noise.factor).sqrt())
    );
    let _ = writeln!(out, "where it fails");
    for contrast in &diagnosis.contrasts {
        let bar = "█".repeat(((contrast.ratio.sqrt() - 0.9) * 10.0).clamp(0.0, 40.0) as usize);
        let line = format!(
            "  {:<20} × {:<6} {:<12} {bar}",
            words(contrast.name),
            number(contrast.ratio.sqrt()),
            p_value(contrast.p_value)
        );
        let _ = writeln!(out, "{}", line.trim_end());
    }
    let carried = diagnosis.patterns.iter().filter(|p| p.p_value < CARRIES);
    for pattern in carried.take(2) {
        let line = format!(
            "  → as if {}, {} (evidence {:+.0} nats)",
            pattern.words,
            p_value(pattern.p_value),
            pattern.log_evidence
        );
        let _ = writeln!(out, "{}", wrap(&line, 4));
    }
    let _ = write!(out, "\n{}", answer(diagnosis));
    out.push_str(&next.map_or_else(String::new, promise));
    let others: Vec<String> = diagnosis
        .candidates
        .iter()
        .filter(|c| !diagnosis.effects.contains(&c.effect))
        .map(|c| format!("{} {:+.0}", c.effect, c.log_evidence))
        .collect();
    if !others.is_empty() {
        let rest = others.len().saturating_sub(SHOWN);
        let more = if rest > 0 {
            format!(" · {rest} more")
        } else {
            String::new()
        };
        let shown = others[..others.len().min(SHOWN)].join(" · ");
        let line = format!("also tried  {shown}{more} (evidence, nats)");
        let _ = writeln!(out, "{}", wrap(&line, 12));
    }
    if !diagnosis.cannot_see.is_empty() {
        let _ = writeln!(out, "cannot see");
        for row in &diagnosis.cannot_see {
            let _ = writeln!(
                out,
                "{}",
                wrap(&format!("  {} · {}", row.effect, row.why), 4)
            );
        }
    }
    out
}

fn lines(all: &[usize]) -> String {
    let mut shown: Vec<String> = all.iter().take(8).map(usize::to_string).collect();
    if all.len() > 8 {
        shown.push("…".to_owned());
    }
    shown.join(", ")
}

/// A contrast in words.
pub fn words(contrast: &str) -> &'static str {
    match contrast {
        "pose" => "between poses",
        "load" => "between loads",
        "direction" => "between directions",
        "time" => "over time",
        _ => "between repeats",
    }
}

/// A probability in words.
pub fn p_value(p: f64) -> String {
    if p < 1e-16 {
        "p < 1e-16".to_owned()
    } else if p < 0.01 {
        format!("p = {p:.0e}")
    } else {
        format!("p = {p:.2}")
    }
}

fn answer(diagnosis: &Diagnosis) -> String {
    let find = |id: &str| diagnosis.candidates.iter().find(|c| c.effect == id);
    let fall = |out: &mut String| {
        let (before, after) = (&diagnosis.base, &diagnosis.fit);
        let _ = writeln!(
            out,
            "         fitted error {} → {}",
            length(before.fit.position_rms_m),
            length(after.fit.position_rms_m)
        );
        if let (Some(before), Some(after)) = (before.heldout, after.heldout) {
            let _ = writeln!(
                out,
                "         error of poses not fitted {} → {}",
                length(before.position_rms_m),
                length(after.position_rms_m)
            );
        }
    };
    let mut out = String::new();
    match diagnosis.verdict {
        Verdict::Nothing => {
            let _ = writeln!(out, "verdict  nothing detectable is missing");
        }
        Verdict::CannotTell => {
            let _ = writeln!(out, "{}", wrap(&words_of_verdict(diagnosis), 9));
        }
        Verdict::Named | Verdict::NamedIncomplete => {
            for effect in &diagnosis.effects {
                let found = find(effect).map_or_else(String::new, |c| {
                    format!(
                        "   λ {}, evidence {:+.0} nats",
                        number(c.lambda),
                        c.log_evidence
                    )
                });
                let _ = writeln!(out, "missing  {effect}{found}");
                if *effect == Role::Ripple.id() {
                    out.push_str(&waves(&diagnosis.waves));
                } else if let Some(term) = diagnosis.fit.model.term(effect)
                    && !term.effect.options().is_empty()
                {
                    // of the forms tried, not the usual one
                    let options = term.effect.options().to_string();
                    for option in options.lines().filter(|line| !line.is_empty()) {
                        let _ = writeln!(out, "         {option}");
                    }
                }
            }
            fall(&mut out);
            if diagnosis.verdict == Verdict::NamedIncomplete {
                let line = "         something is left that no effect of the catalogue explains: its form may \
                            be wrong";
                let _ = writeln!(out, "{}", wrap(line, 9));
                if let Some(effect) = &diagnosis.refused {
                    let _ = writeln!(out, "{}", wrap(&format!("         {}", refusal(effect)), 9));
                }
            }
        }
        Verdict::Alias => {
            let line = format!(
                "missing  one of {}: this campaign cannot tell which",
                diagnosis.effects.join(", ")
            );
            let _ = writeln!(out, "{}", wrap(&line, 9));
            if diagnosis.named == [Role::Ripple.id()] {
                out.push_str(&waves(&diagnosis.waves));
            }
            fall(&mut out);
        }
        Verdict::Unknown => {
            let line = "verdict  something is missing that the catalogue does not hold; where it fails is all \
                        that can be said";
            let _ = writeln!(out, "{}", wrap(line, 9));
        }
    }
    out
}

/// Why an effect that alarms was not added.
pub fn refusal(effect: &str) -> String {
    format!("{effect} alarms, but with it poses left out are predicted no better")
}

/// Waves by their size, a line each; the small ones of many are counted.
pub fn waves(all: &[Wave]) -> String {
    let mut sorted: Vec<&Wave> = all.iter().collect();
    sorted.sort_by(|a, b| b.amplitude_rad.total_cmp(&a.amplitude_rad));
    let width = sorted.iter().map(|wave| wave.joint.chars().count());
    let width = width.max().unwrap_or(0);
    let mut out = String::new();
    for wave in sorted.iter().take(WAVES) {
        let also = match &wave.also[..] {
            [] => String::new(),
            rivals => {
                let few: Vec<String> = rivals.iter().take(3).map(|n| significant(*n, 3)).collect();
                let more = if rivals.len() > few.len() { " …" } else { "" };
                format!("; or {}{more}", few.join(", "))
            }
        };
        let cycles = format!("{} ± {}", wave.cycles, significant(wave.cycles_std, 1));
        let line = format!(
            "           on joint {:<width$}  {cycles} cycles per turn, {}{also}",
            wave.joint,
            angle(wave.amplitude_rad),
        );
        let _ = writeln!(out, "{}", wrap(&line, 13));
    }
    if sorted.len() > WAVES {
        let smaller = count(sorted.len() - WAVES, "smaller wave");
        let _ = writeln!(out, "           and {smaller}; --json lists all");
    }
    out
}

/// The verdict in one sentence.
pub fn words_of_verdict(diagnosis: &Diagnosis) -> String {
    let effects = diagnosis.effects.join(", ");
    match diagnosis.verdict {
        Verdict::Nothing => "verdict  nothing more is detectable".to_owned(),
        Verdict::CannotTell => format!(
            "verdict  cannot tell: {}",
            diagnosis.untold.as_deref().unwrap_or("there is no fit")
        ),
        Verdict::Named => format!("verdict  {effects}; then nothing more is detectable"),
        Verdict::NamedIncomplete => format!(
            "verdict  {effects}; something is left that no effect of the catalogue explains"
        ),
        Verdict::Alias => format!(
            "verdict  one of {effects}: this campaign cannot tell which; then nothing more is detectable"
        ),
        Verdict::Unknown => {
            "verdict  something is left that the catalogue does not hold".to_owned()
        }
    }
}
