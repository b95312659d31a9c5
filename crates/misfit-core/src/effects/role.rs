//! What a parameter is and where it acts, said by its effect, so that nobody outside reads it off a name.

use super::{CATALOGUE, Entry};

/// A part that one effect of the catalogue plays, and that others treat apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Pose of the tracker in the robot's base: six parameters.
    TrackerFrame,
    /// Poses of the targets on their links: six parameters each.
    TargetFrame,
    /// Constant error of each joint's reading.
    Offset,
    /// Poses of the joints on their links: six parameters each.
    Geometry,
    /// Compliance of each joint: one parameter each, a stiffness when inverted.
    Spring,
    /// Springs that become stiffer beyond a knee.
    Hardening,
    /// Error of each joint with one and two cycles per turn.
    Transmission,
    /// Waves with the cycles that [`super::Effect::waves`] names.
    Ripple,
    /// Motion of the tracker with time.
    Drift,
    /// Expansion with temperature.
    Thermal,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::TrackerFrame,
        Self::TargetFrame,
        Self::Offset,
        Self::Geometry,
        Self::Spring,
        Self::Hardening,
        Self::Transmission,
        Self::Ripple,
        Self::Drift,
        Self::Thermal,
    ];

    /// The effect that plays it.
    pub fn entry(self) -> &'static Entry {
        let Some(entry) = CATALOGUE.iter().find(|entry| entry.role == Some(self)) else {
            unreachable!("each role is played by one effect, as a test of this file checks")
        };
        entry
    }

    /// Its effect's id.
    pub fn id(self) -> &'static str {
        self.entry().id
    }

    /// Is it a frame of the measurement: tracker or target?
    pub fn is_frame(self) -> bool {
        matches!(self, Self::TrackerFrame | Self::TargetFrame)
    }

    /// Are its parameters redundant by nature, so that only combinations of them have values?
    pub fn is_redundant(self) -> bool {
        self.is_frame() || self == Self::Geometry
    }

    /// Is it kinematics or frames: what a calibration without loads has?
    pub fn is_kinematic(self) -> bool {
        self.is_redundant() || self == Self::Offset
    }

    /// Is it part of the models that a diagnosis starts from?
    pub fn is_of_base_model(self) -> bool {
        self.is_kinematic() || self == Self::Spring
    }
}

/// Where a parameter acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// At a joint of the robot, by its index.
    Joint(usize),
    /// At a target of the setup, by its index.
    Target(usize),
    /// Nowhere in particular, or everywhere.
    Whole,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_role_is_played_by_one_effect() {
        for role in Role::ALL {
            let players = CATALOGUE.iter().filter(|entry| entry.role == Some(role));
            assert_eq!(players.count(), 1, "{role:?}");
        }
        let roles: Vec<Role> = CATALOGUE.iter().filter_map(|entry| entry.role).collect();
        assert_eq!(roles.len(), Role::ALL.len());
    }

    #[test]
    fn groups_of_roles_hold_the_effects_of_the_handbook() {
        let ids = |is: fn(Role) -> bool| -> Vec<&str> {
            let roles = Role::ALL.into_iter().filter(|&role| is(role));
            roles.map(Role::id).collect()
        };
        let all = [
            "tracker_frame",
            "target_offset",
            "joint_offset",
            "geometry",
            "joint_compliance",
        ];
        assert_eq!(ids(Role::is_frame), all[..2]);
        assert_eq!(
            ids(Role::is_redundant),
            ["tracker_frame", "target_offset", "geometry"]
        );
        assert_eq!(ids(Role::is_kinematic), all[..4]);
        assert_eq!(ids(Role::is_of_base_model), all);
    }
}
