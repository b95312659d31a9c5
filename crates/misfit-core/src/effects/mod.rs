//! The catalogue of physical effects.
//!
//! An effect is one file: its `//!` comment is its handbook page, its [`Effect`] implementation its law for
//! the model and its realisation in the plant. [`CATALOGUE`] is the only place that lists them.

mod backlash;
mod base_compliance;
mod bearing_tilt;
mod expression;
mod frame_drift;
mod ft_bias;
mod ft_gain;
mod ft_misalignment;
mod gear_ratio;
mod gear_ripple;
mod geometry;
mod gravity_backlash;
mod gravity_compensator;
mod gravity_direction;
mod hysteresis;
mod joint_compliance;
mod joint_hardening;
mod joint_offset;
mod link_flexibility;
mod link_mass;
mod list;
pub mod need;
mod options;
mod payload_com;
mod payload_mass;
mod role;
pub mod table;
mod target_offset;
mod thermal_expansion;
mod timestamp_lag;
mod tracker_frame;
mod tracker_scale;
mod transmission_error;
mod wrist_coupling;

use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::robot::JointKind;
use crate::setup::Setup;
pub use list::{Base, EffectList};
use nalgebra::SVector;
pub use need::Need;
use num_dual::DualSVec64;
pub use role::{Place, Role};
use serde::de::DeserializeOwned;
use std::fmt::Debug;
use std::sync::Arc;

/// Every effect, in the order of the tables and of the default model.
pub const CATALOGUE: &[Entry] = &[
    entry::<tracker_frame::TrackerFrame>(include_str!("tracker_frame.rs")),
    entry::<target_offset::TargetOffset>(include_str!("target_offset.rs")),
    entry::<joint_offset::JointOffset>(include_str!("joint_offset.rs")),
    entry::<geometry::Geometry>(include_str!("geometry.rs")),
    entry::<gear_ratio::GearRatio>(include_str!("gear_ratio.rs")),
    entry::<transmission_error::TransmissionError>(include_str!("transmission_error.rs")),
    entry::<gear_ripple::GearRipple>(include_str!("gear_ripple.rs")),
    entry::<wrist_coupling::WristCoupling>(include_str!("wrist_coupling.rs")),
    entry::<backlash::Backlash>(include_str!("backlash.rs")),
    entry::<timestamp_lag::TimestampLag>(include_str!("timestamp_lag.rs")),
    entry::<thermal_expansion::ThermalExpansion>(include_str!("thermal_expansion.rs")),
    entry::<joint_compliance::JointCompliance>(include_str!("joint_compliance.rs")),
    entry::<joint_hardening::JointHardening>(include_str!("joint_hardening.rs")),
    entry::<gravity_backlash::GravityBacklash>(include_str!("gravity_backlash.rs")),
    entry::<hysteresis::Hysteresis>(include_str!("hysteresis.rs")),
    entry::<bearing_tilt::BearingTilt>(include_str!("bearing_tilt.rs")),
    entry::<link_flexibility::LinkFlexibility>(include_str!("link_flexibility.rs")),
    entry::<base_compliance::BaseCompliance>(include_str!("base_compliance.rs")),
    entry::<link_mass::LinkMass>(include_str!("link_mass.rs")),
    entry::<gravity_compensator::GravityCompensator>(include_str!("gravity_compensator.rs")),
    entry::<gravity_direction::GravityDirection>(include_str!("gravity_direction.rs")),
    entry::<payload_mass::PayloadMass>(include_str!("payload_mass.rs")),
    entry::<payload_com::PayloadCom>(include_str!("payload_com.rs")),
    entry::<frame_drift::FrameDrift>(include_str!("frame_drift.rs")),
    entry::<tracker_scale::TrackerScale>(include_str!("tracker_scale.rs")),
    entry::<ft_bias::FtBias>(include_str!("ft_bias.rs")),
    entry::<ft_gain::FtGain>(include_str!("ft_gain.rs")),
    entry::<ft_misalignment::FtMisalignment>(include_str!("ft_misalignment.rs")),
    entry::<expression::Expression>(include_str!("expression.rs")),
];

/// Where on the way from encoder to tracker an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Moves joints or nodes whatever the load.
    Rigid,
    /// Changes masses, payload, gravity or torques.
    Load,
    /// Moves joints or nodes under the load: sees the wrench at the node it moves, and no other but those that
    /// [`Effect::distant`] names.
    Elastic,
    /// Changes what the wrist sensor reads; sees what it should read.
    Sensor,
    /// Moves the frames of tracker or target, or scales the tracker.
    Instrument,
}

impl Stage {
    /// One word for tables.
    pub fn word(self) -> &'static str {
        match self {
            Stage::Rigid => "rigid",
            Stage::Load => "load",
            Stage::Elastic => "elastic",
            Stage::Sensor => "sensor",
            Stage::Instrument => "instrument",
        }
    }
}

/// One number of an effect; all its values are in its SI unit. Zero is neutral: an effect with all its parameters at zero
/// changes nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name within the effect, e.g. the joint's.
    pub name: String,
    /// Where it acts.
    pub place: Place,
    /// Its effect's role.
    pub role: Option<Role>,
    /// SI unit.
    pub unit: String,
    /// Size that would not surprise; scales the parameter in rank decisions.
    pub typical: f64,
    /// Least value allowed.
    pub lower: f64,
    /// Greatest value allowed.
    pub upper: f64,
    /// Start value, or the value it is held at.
    pub value: f64,
    /// Estimated, or held (and still applied).
    pub vary: bool,
}

impl Parameter {
    /// A free, unbounded parameter of the whole robot or setup that starts at zero.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, typical: f64) -> Self {
        Self {
            name: name.into(),
            place: Place::Whole,
            role: None,
            unit: unit.into(),
            typical,
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            value: 0.0,
            vary: true,
        }
    }

    /// The same, never below `lower`.
    pub fn at_least(self, lower: f64) -> Self {
        Self { lower, ..self }
    }

    /// The same, acting somewhere.
    pub fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }

    /// The joint at which it acts, if it is of one.
    pub fn joint(&self) -> Option<usize> {
        match self.place {
            Place::Joint(joint) => Some(joint),
            Place::Target(_) | Place::Whole => None,
        }
    }

    /// Do both act at one joint or target?
    pub fn shares_place_with(&self, other: &Self) -> bool {
        self.place != Place::Whole && self.place == other.place
    }
}

/// One physical effect, with its law for the model and its realisation in the plant.
pub trait Effect: Debug + Send + Sync + 'static {
    /// File stem, `kind` in TOML, word on the command line, name in reports.
    const ID: &'static str;
    /// Where it acts.
    const STAGE: Stage;
    /// What a campaign must have for it to be seen.
    const NEEDS: &'static [Need] = &[];
    /// The part that it plays, if others treat it apart.
    const ROLE: Option<Role> = None;
    /// Effects of the catalogue that look exactly the same in some campaigns that meet its needs.
    const ALIASES: &'static [&'static str] = &[];
    /// Other options of it, TOML, that a diagnosis tries beside none: numbers of its law that no robot file tells.
    const FORMS: &'static [&'static str] = &[];
    /// Is it an error of the measurement alone? Then the robot goes where it would without, and nothing is to be
    /// compensated.
    const OF_MEASUREMENT: bool = false;
    /// [`Effect::ID`], but where one kind makes many effects each has a name of its own.
    fn id(&self) -> &str {
        Self::ID
    }
    /// [`Effect::STAGE`], but where it depends on options.
    fn stage(&self) -> Stage {
        Self::STAGE
    }
    /// [`Effect::NEEDS`], but where they depend on options.
    fn needs(&self) -> &[Need] {
        Self::NEEDS
    }
    /// Joints whose wrenches (torques) an elastic law reads, if one of them is not the joint that it moves or moves
    /// behind: all that it reads then; none for a law that sees its own node alone.
    fn distant(&self, _setup: &Setup) -> Vec<usize> {
        Vec::new()
    }
    /// Waves whose cycles are options, as joint and cycles per turn: two parameters each, of the sine and of the cosine.
    fn waves(&self, _setup: &Setup) -> Vec<(usize, f64)> {
        Vec::new()
    }
    /// Refuses options that do not fit the robot.
    ///
    /// # Errors
    /// What was found, and what is accepted.
    fn check(&self, _setup: &Setup) -> Result<(), String> {
        Ok(())
    }
    /// Its parameters for a robot with its targets, in the order that `perturb` and `install` take them.
    fn parameters(&self, setup: &Setup) -> Vec<Parameter>;
    /// The model's side: adds to the posture.
    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>);
    /// The plant's side.
    ///
    /// # Errors
    /// If the plant cannot realise these values.
    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError>;
}

/// One parameter for each observed joint: unit and typical size where it turns, and where it slides.
fn by_joint(
    setup: &Setup,
    turns: (&'static str, f64),
    slides: (&'static str, f64),
) -> Vec<Parameter> {
    let of_joint = |&index: &usize| {
        let joint = &setup.robot.joints[index];
        let (unit, typical) = match joint.kind {
            JointKind::Prismatic => slides,
            JointKind::Revolute | JointKind::Continuous => turns,
        };
        Parameter::new(&joint.name, unit, typical).at(Place::Joint(index))
    };
    setup.observed.iter().map(of_joint).collect()
}

/// The observed joints that turn.
fn turning(setup: &Setup) -> impl Iterator<Item = usize> + '_ {
    let observed = setup.observed.iter().copied();
    observed.filter(|&joint| setup.robot.joints[joint].kind != JointKind::Prismatic)
}

/// Refuses values that no spring can have.
fn at_least_zero(effect: &'static str, parameter: &str, found: f64) -> Result<(), SpecError> {
    if found.is_finite() && found >= 0.0 {
        return Ok(());
    }
    Err(SpecError::Value {
        effect,
        parameter: parameter.to_owned(),
        found,
        accepted: "a compliance of zero (rigid) or more",
    })
}

/// Directions that one evaluation with dual numbers carries.
pub const DIRECTIONS: usize = 8;
/// Dual numbers with [`DIRECTIONS`] derivatives.
pub type Dual = DualSVec64<DIRECTIONS>;

/// A dual number with unit derivative along one direction.
pub fn seeded(value: f64, direction: usize) -> Dual {
    let mut rates = SVector::<f64, DIRECTIONS>::zeros();
    rates[direction] = 1.0;
    Dual::new(value, num_dual::Derivative::some(rates))
}

/// The derivatives of a dual number, if it has any.
pub fn rates(value: &Dual) -> Option<SVector<f64, DIRECTIONS>> {
    (value.eps != num_dual::Derivative::none())
        .then(|| value.eps.unwrap_generic(nalgebra::Const, nalgebra::Const))
}

/// The object-safe face of [`Effect`].
pub trait AnyEffect: Debug + Send + Sync {
    /// [`Effect::ID`].
    fn kind(&self) -> &'static str;
    /// [`Effect::id`].
    fn id(&self) -> &str;
    /// [`Effect::stage`].
    fn stage(&self) -> Stage;
    /// [`Effect::needs`].
    fn needs(&self) -> &[Need];
    /// [`Effect::distant`].
    fn distant(&self, setup: &Setup) -> Vec<usize>;
    /// [`Effect::ROLE`].
    fn role(&self) -> Option<Role>;
    /// [`Effect::waves`].
    fn waves(&self, setup: &Setup) -> Vec<(usize, f64)>;
    /// [`Effect::ALIASES`].
    fn aliases(&self) -> &'static [&'static str];
    /// [`Effect::OF_MEASUREMENT`].
    fn is_of_measurement(&self) -> bool;
    /// The options that it was made with, as in its `[[effect]]` table.
    fn options(&self) -> &toml::Table;
    /// [`Effect::check`].
    ///
    /// # Errors
    /// As there.
    fn check(&self, setup: &Setup) -> Result<(), String>;
    /// [`Effect::parameters`].
    fn parameters(&self, setup: &Setup) -> Vec<Parameter>;
    /// [`Effect::perturb`] with plain numbers.
    fn perturb(&self, p: &[f64], posture: &mut Posture<'_, f64>);
    /// [`Effect::perturb`] with derivatives.
    fn perturb_dual(&self, p: &[Dual], posture: &mut Posture<'_, Dual>);
    /// [`Effect::install`].
    ///
    /// # Errors
    /// As there.
    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError>;
}

/// An effect and the options that it was made with.
#[derive(Debug)]
struct Made<E> {
    effect: E,
    options: toml::Table,
}

/// An effect that is not in the catalogue, for models and plants of one's own.
pub fn own<E: Effect>(effect: E) -> Arc<dyn AnyEffect> {
    let options = toml::Table::new();
    Arc::new(Made { effect, options })
}

impl<E: Effect> AnyEffect for Made<E> {
    fn kind(&self) -> &'static str {
        E::ID
    }
    fn id(&self) -> &str {
        Effect::id(&self.effect)
    }
    fn stage(&self) -> Stage {
        Effect::stage(&self.effect)
    }
    fn needs(&self) -> &[Need] {
        Effect::needs(&self.effect)
    }
    fn distant(&self, setup: &Setup) -> Vec<usize> {
        Effect::distant(&self.effect, setup)
    }
    fn role(&self) -> Option<Role> {
        E::ROLE
    }
    fn waves(&self, setup: &Setup) -> Vec<(usize, f64)> {
        Effect::waves(&self.effect, setup)
    }
    fn aliases(&self) -> &'static [&'static str] {
        E::ALIASES
    }
    fn is_of_measurement(&self) -> bool {
        E::OF_MEASUREMENT
    }
    fn options(&self) -> &toml::Table {
        &self.options
    }
    fn check(&self, setup: &Setup) -> Result<(), String> {
        Effect::check(&self.effect, setup)
    }
    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let mut parameters = Effect::parameters(&self.effect, setup);
        for parameter in &mut parameters {
            parameter.role = E::ROLE;
        }
        parameters
    }
    fn perturb(&self, p: &[f64], posture: &mut Posture<'_, f64>) {
        Effect::perturb(&self.effect, p, posture);
    }
    fn perturb_dual(&self, p: &[Dual], posture: &mut Posture<'_, Dual>) {
        Effect::perturb(&self.effect, p, posture);
    }
    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        Effect::install(&self.effect, p, setup, plant)
    }
}

/// A row of the catalogue.
pub struct Entry {
    /// [`Effect::ID`].
    pub id: &'static str,
    /// [`Effect::STAGE`].
    pub stage: Stage,
    /// [`Effect::ROLE`].
    pub role: Option<Role>,
    /// [`Effect::NEEDS`].
    pub needs: &'static [Need],
    /// [`Effect::ALIASES`].
    pub aliases: &'static [&'static str],
    /// [`Effect::FORMS`].
    pub forms: &'static [&'static str],
    source: &'static str,
    make: fn(toml::Table) -> Result<Arc<dyn AnyEffect>, toml::de::Error>,
}

impl Debug for Entry {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "Entry({})", self.id)
    }
}

const fn entry<E: Effect + DeserializeOwned>(source: &'static str) -> Entry {
    Entry {
        id: E::ID,
        stage: E::STAGE,
        role: E::ROLE,
        needs: E::NEEDS,
        aliases: E::ALIASES,
        forms: E::FORMS,
        source,
        make: |options| {
            let effect: E = toml::Value::Table(options.clone()).try_into()?;
            Ok(Arc::new(Made { effect, options }))
        },
    }
}

impl Entry {
    /// The effect with the options of its `[[effect]]` table, without `kind` and what the model file itself
    /// reads.
    ///
    /// # Errors
    /// For options that it does not know.
    pub fn make(&self, options: toml::Table) -> Result<Arc<dyn AnyEffect>, toml::de::Error> {
        (self.make)(options)
    }

    /// Does it make no effect without options?
    pub fn needs_options(&self) -> bool {
        self.make(toml::Table::new()).is_err()
    }

    /// The effect in all forms that a diagnosis tries, the usual first; none if it needs options.
    pub fn all_forms(&self) -> Vec<Arc<dyn AnyEffect>> {
        let Ok(usual) = self.make(toml::Table::new()) else {
            return Vec::new();
        };
        let others = self.forms.iter().filter_map(|form| form.parse().ok());
        let others = others.filter_map(|options| self.make(options).ok());
        std::iter::once(usual).chain(others).collect()
    }

    /// Its handbook page, Markdown: the `//!` comment of its file.
    pub fn page(&self) -> String {
        let lines = self
            .source
            .lines()
            .map_while(|line| line.strip_prefix("//!"));
        let lines: Vec<&str> = lines
            .map(|line| line.strip_prefix(' ').unwrap_or(line))
            .collect();
        lines.join("\n")
    }

    /// The first sentence of its page.
    pub fn summary(&self) -> String {
        let page = self.page();
        let first: Vec<&str> = page.lines().take_while(|line| !line.is_empty()).collect();
        first.join(" ")
    }
}

/// Finds an effect by its id.
pub fn find(id: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.id == id)
}

/// All ids, for messages.
pub fn ids() -> String {
    let ids: Vec<&str> = CATALOGUE.iter().map(|entry| entry.id).collect();
    ids.join(", ")
}
