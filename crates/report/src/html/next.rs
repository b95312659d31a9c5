//! What to do next: commands, and poses that settle an alias.

use super::{Origin, Results, Step};
use misfit_arm::robot::JointKind;
use misfit_campaign::Campaign;
use misfit_campaign::numbers::number;
use misfit_core::plan::Outlook;

/// What the section shows.
pub(super) struct Section {
    pub steps: Vec<Step>,
    /// What the poses promise.
    pub promises: Vec<String>,
    /// Heads of the table of poses: joint and unit.
    pub joints: Vec<String>,
    /// Joint angles of the proposed poses.
    pub poses: Vec<Vec<String>>,
    /// Why there are none.
    pub no_poses: &'static str,
}

pub(super) fn section(campaign: &Campaign, results: &Results<'_>, origin: &Origin) -> Section {
    let mut section = Section {
        steps: origin.next.clone(),
        promises: Vec::new(),
        joints: Vec::new(),
        poses: Vec::new(),
        no_poses: match results.diagnosis() {
            None => "A fit asks for no poses; misfit plan proposes those that make it more exact.",
            Some(diagnosis) if diagnosis.alike.is_empty() => {
                "No two effects are to be told apart; misfit plan proposes poses that make the fit more exact."
            }
            Some(_) => "No poses could be found that tell these effects apart.",
        },
    };
    let Some(plan) = results.next() else {
        return section;
    };
    let observed = &results.fit().model.setup.observed;
    let joint = |&joint: &usize| {
        let joint = &campaign.robot.joints[joint];
        match joint.kind {
            JointKind::Prismatic => (format!("{}, mm", joint.name), 1e3),
            JointKind::Revolute | JointKind::Continuous => {
                (format!("{}, °", joint.name), 1f64.to_degrees())
            }
        }
    };
    let columns: Vec<(String, f64)> = observed.iter().map(joint).collect();
    let pose = |pose: &Vec<f64>| {
        let angles = observed.iter().zip(&columns);
        angles
            .map(|(&joint, (_, scale))| format!("{:.2}", pose[joint] * scale))
            .collect()
    };
    section.poses = plan.poses.iter().map(pose).collect();
    section.joints = columns.into_iter().map(|(head, _)| head).collect();
    for way in &plan.ways {
        let word = match way.outlook() {
            Outlook::Decisive => "these poses will tell".to_owned(),
            Outlook::Weak => format!("these poses hardly tell: λ {} of 60", number(way.proposed)),
            Outlook::Unseen => "it does not show in such readings".to_owned(),
            Outlook::Never => "no poses can; misfit effects show says what can".to_owned(),
        };
        section.promises.push(format!(
            "If it is {} and not {}: {word}.",
            way.effect, way.other
        ));
    }
    section
}
