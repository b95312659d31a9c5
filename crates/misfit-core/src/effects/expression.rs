//! A law of the user's own, written as a formula in a model file: no compiler is needed.
//!
//! ## Law
//! `[[effect]]` (in a scenario `[[truth]]`) with `kind = "expression"` and
//!
//! - `name`: the effect's name in reports, tables and JSON; none of the catalogue's
//! - `acts_on`: what the law's value is added to: the angle `q3` of a joint (rad; m where it slides), or a small motion
//!   of the frame behind joint 3, in the frame that the joint moves: `tx3 ty3 tz3` (m), `rx3 ry3 rz3` (rad)
//! - `law`: the formula
//! - `parameters`: a table of `name = { unit = "rad", typical = 1e-4 }`; all are estimated, and at zero they must
//!   change nothing
//!
//! In the formula stand numbers, `+ - * / ^`, parentheses, `pi`, the functions sin cos tan asin acos atan atan2 sinh cosh
//! tanh exp ln sqrt abs sign min max pow, the parameters, and
//!
//! - `q3`: a joint's encoder angle, rad (m)
//! - `tau3`: the torque of the load about a joint's axis, N·m (force along it, N)
//! - `approach3`: direction of a joint's last motion, -1, 0 or 1
//! - `temperature`: of the link behind the joint acted on where it was measured, else of the robot, above the campaign's
//!   mean, K
//! - `time`: from the middle of the campaign, s
//! - `payload`: mass of the payload as stated, kg
//!
//! Joints are counted from 1, from the base to the target, those alone that a reading can depend on. Where arms branch a
//! count is unclear, and refused: there, and anywhere else, joints are named, as `q[r1_e]`, `tau[r1_e]`, `rx[r1_e]`.
//!
//! ## Signature
//! What the formula says. A law with torques is elastic: it follows the load, and the loads follow it. Any joint's torque
//! may move any other joint.
//!
//! ## Confused with
//! Whatever has the same form: `a` beside a constant is `joint_offset`, `a*q3` is `gear_ratio`, `a*sin(q3)` is
//! `transmission_error`, `a*tau3` is `joint_compliance`. What the model holds already is said to be seen only in
//! combination.
//!
//! ## Plant
//! The plant has the same formula, as data, but computes it by a second path, from MuJoCo's torques: on angles as the
//! command's change or the joint's wind-up, on frames as the motion of a hinge or slide without spring behind the joint.
//!
//! ## Sources
//! The user's own; formulas are read as in Pratt 1973, *Top down operator precedence*, POPL.

use super::{Dual, Effect, Need, Parameter, Stage, rates, seeded};
use crate::dual_quaternion::{Scalar, constant};
use crate::formula::{Formula, Name, is_reserved, is_word};
use crate::plant::{Command, PlantSpec, SpecError};
use crate::posture::Posture;
use crate::robot::JointKind;
use crate::setup::Setup;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// One law.
#[derive(Debug, Clone, Deserialize)]
#[serde(try_from = "Options")]
pub struct Expression {
    name: String,
    /// What `acts_on` says, and what it means.
    acts_on: String,
    moved: Moved,
    joint: JointName,
    law: Formula,
    /// What each name of the law stands for.
    sources: Vec<Source>,
    parameters: Vec<Parameter>,
    needs: Vec<Need>,
}

/// The keys of its table.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Options {
    name: Option<String>,
    acts_on: Option<String>,
    law: Option<String>,
    parameters: Option<BTreeMap<String, ParameterOptions>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterOptions {
    unit: Option<String>,
    typical: Option<f64>,
}

/// What a law moves.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Moved {
    /// The joint itself.
    Angle,
    /// A component of the motion of its node: 0 to 2 translation, 3 to 5 rotation.
    Frame(usize),
}

/// A joint as the user names it.
#[derive(Debug, Clone, PartialEq)]
enum JointName {
    /// Counted from 1 along the chain.
    Number(usize),
    /// By its name in the robot file.
    Word(String),
}

/// What a name in a law stands for.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    Parameter(usize),
    Angle(JointName),
    Torque(JointName),
    Approach(JointName),
    Temperature,
    Time,
    Payload,
}

const FRAME_WORDS: [&str; 6] = ["tx", "ty", "tz", "rx", "ry", "rz"];

const VARIABLES: &str = "q1 or q[joint], tau1 or tau[joint], approach1 or approach[joint], temperature, time, \
                         payload, pi";

impl TryFrom<Options> for Expression {
    type Error = String;

    fn try_from(options: Options) -> Result<Self, String> {
        let missing = |key: &str| {
            format!(
                "{key} is missing; a law of your own stands in a model file, with name, acts_on, law and \
                 parameters: misfit effects show expression"
            )
        };
        let name = options.name.ok_or_else(|| missing("name"))?;
        if !is_word(&name) {
            return Err(format!(
                "name is \"{}\"; accepted: letters, digits and _, not a digit first",
                name.escape_debug()
            ));
        }
        if super::find(&name).is_some() {
            return Err(format!(
                "name is \"{name}\", which is an effect of the catalogue; accepted: any other word"
            ));
        }
        let named = |message: String| format!("{name}: {message}");
        let acts_on = options.acts_on.ok_or_else(|| named(missing("acts_on")))?;
        let (moved, joint) = place(&acts_on).ok_or_else(|| {
            let found = acts_on.escape_debug();
            named(format!(
                "acts_on is \"{found}\"; accepted: q3 or q[joint], an angle, or tx ty tz rx ry rz with a number \
                 or [joint], a motion of the frame behind it"
            ))
        })?;
        let law = options.law.ok_or_else(|| named(missing("law")))?;
        let law = Formula::parse(&law).map_err(|error| named(format!("law: {error}")))?;
        let parameters = options.parameters.unwrap_or_default();
        let parameters = parameters_of(parameters, &law).map_err(named)?;
        let sources: Vec<Source> = law
            .names
            .iter()
            .map(|mentioned| source(mentioned, &parameters, &law))
            .collect::<Result<_, _>>()
            .map_err(named)?;
        let mut needs = Vec::new();
        for source in &sources {
            let need = match source {
                Source::Parameter(_) | Source::Angle(_) => continue,
                Source::Torque(_) => Need::Load,
                Source::Approach(_) => Need::Approach,
                Source::Temperature => Need::Temperature,
                Source::Time => Need::Time,
                Source::Payload => Need::Payload,
            };
            if !needs.contains(&need) {
                needs.push(need);
            }
        }
        Ok(Self {
            name,
            acts_on,
            moved,
            joint,
            law,
            sources,
            parameters,
            needs,
        })
    }
}

/// What a word of `acts_on` means.
fn place(word: &str) -> Option<(Moved, JointName)> {
    if let Some(joint) = joint_behind(word, "q") {
        return Some((Moved::Angle, joint));
    }
    let found = FRAME_WORDS.iter().enumerate();
    found
        .filter_map(|(k, frame)| Some((Moved::Frame(k), joint_behind(word, frame)?)))
        .next()
}

/// `q3` or `q[name]` with this stem.
fn joint_behind(word: &str, stem: &str) -> Option<JointName> {
    let rest = word.strip_prefix(stem)?;
    if let Some(name) = rest
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
    {
        return Some(JointName::Word(name.to_owned()));
    }
    let digits = !rest.is_empty() && rest.chars().all(|c| c.is_ascii_digit());
    // no robot has as many joints as a number that does not fit
    digits.then(|| JointName::Number(rest.parse().unwrap_or(usize::MAX)))
}

/// What a name without a meaning of its own could be.
fn variable(word: &str) -> Option<Source> {
    match word {
        "temperature" => return Some(Source::Temperature),
        "time" => return Some(Source::Time),
        "payload" => return Some(Source::Payload),
        _ => {}
    }
    let angle = joint_behind(word, "q").map(Source::Angle);
    angle
        .or_else(|| joint_behind(word, "tau").map(Source::Torque))
        .or_else(|| joint_behind(word, "approach").map(Source::Approach))
}

/// The parameters of the table, each fit to be one and used.
fn parameters_of(
    table: BTreeMap<String, ParameterOptions>,
    law: &Formula,
) -> Result<Vec<Parameter>, String> {
    if table.is_empty() {
        return Err(
            "parameters is empty; accepted: a table of name = { unit = \"rad\", typical = 1e-4 }, one at least"
                .to_owned(),
        );
    }
    let mut parameters = Vec::new();
    for (name, ParameterOptions { unit, typical }) in table {
        if !is_word(&name) {
            return Err(format!(
                "a parameter is called \"{}\"; accepted: letters, digits and _, not a digit first",
                name.escape_debug()
            ));
        }
        if is_reserved(&name) || variable(&name).is_some() {
            return Err(format!(
                "a parameter is called {name}, which means something else in a law; accepted: any other word"
            ));
        }
        if !law.names.iter().any(|mentioned| mentioned.text == name) {
            return Err(format!(
                "the parameter {name} is not in the law \"{}\"; accepted: parameters that the law uses",
                law.text.escape_debug()
            ));
        }
        let (Some(unit), Some(typical)) = (unit, typical) else {
            return Err(format!(
                "the parameter {name} lacks unit or typical size; accepted: {name} = {{ unit = \"rad\", typical = \
                 1e-4 }}"
            ));
        };
        if !(typical.is_finite() && typical > 0.0) {
            return Err(format!(
                "typical size of {name} is {typical}; accepted: a number above 0"
            ));
        }
        if unit.is_empty() || unit.chars().any(char::is_control) {
            return Err(format!(
                "unit of {name} is \"{}\"; accepted: SI units, such as rad/(N·m), 1 for none",
                unit.escape_debug()
            ));
        }
        parameters.push(Parameter::new(name, unit, typical));
    }
    Ok(parameters)
}

/// What a name in the law stands for.
fn source(mentioned: &Name, parameters: &[Parameter], law: &Formula) -> Result<Source, String> {
    let known = parameters.iter().position(|p| p.name == mentioned.text);
    let found = known
        .map(Source::Parameter)
        .or_else(|| variable(&mentioned.text));
    found.ok_or_else(|| {
        let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
        let message = format!(
            "nothing is called \"{}\"; known: {}, {VARIABLES}",
            mentioned.text.escape_debug(),
            names.join(", ")
        );
        format!("law: {}", law.error(mentioned.at, message))
    })
}

impl JointName {
    /// The joint of a robot that it means.
    fn find(&self, setup: &Setup) -> Option<usize> {
        match self {
            JointName::Number(number) => {
                let index = number.checked_sub(1)?;
                is_chain(setup)
                    .then(|| setup.observed.get(index).copied())
                    .flatten()
            }
            JointName::Word(name) => {
                let joint = setup.robot.joint(name)?;
                setup.observed.contains(&joint).then_some(joint)
            }
        }
    }

    /// Why it means none.
    fn unknown(&self, setup: &Setup) -> String {
        let names = setup.observed.iter().enumerate();
        let chain = is_chain(setup);
        let names: Vec<String> = names
            .map(|(k, &joint)| match chain {
                true => format!("{} [{}]", k + 1, setup.robot.joints[joint].name),
                false => format!("[{}]", setup.robot.joints[joint].name),
            })
            .collect();
        let known = names.join(", ");
        match self {
            JointName::Number(_) if !chain => {
                format!("joints are not counted where arms branch; accepted: {known}")
            }
            JointName::Number(number) => format!("there is no joint {number}; known: {known}"),
            JointName::Word(name) => format!(
                "no joint before a target is called \"{}\"; known: {known}",
                name.escape_debug()
            ),
        }
    }
}

/// Does each observed joint hang on the one before?
fn is_chain(setup: &Setup) -> bool {
    let parents = setup
        .observed
        .iter()
        .map(|&joint| setup.robot.joints[joint].parent);
    let bodies = setup.observed.iter().map(|&joint| joint + 1);
    parents
        .skip(1)
        .zip(bodies)
        .all(|(parent, body)| parent == body)
}

impl Source {
    fn joint(&self) -> Option<&JointName> {
        match self {
            Source::Angle(joint) | Source::Torque(joint) | Source::Approach(joint) => Some(joint),
            _ => None,
        }
    }
}

impl Expression {
    /// The law's value in a posture; not a number where the reading does not say what it needs.
    fn value<S: Scalar>(&self, p: &[S], posture: &Posture<'_, S>, moved: usize) -> S {
        let setup = posture.setup;
        let said = |need: Need, value: S| match need.is_said(posture.reading) {
            true => value,
            false => constant(f64::NAN),
        };
        let of_joint = |joint: &JointName, of: &dyn Fn(usize) -> S| {
            joint.find(setup).map_or(constant(f64::NAN), of)
        };
        let values = self.sources.iter().map(|source| match source {
            Source::Parameter(index) => p[*index],
            Source::Angle(joint) => of_joint(joint, &|joint| posture.q(joint)),
            Source::Torque(joint) => of_joint(joint, &|joint| posture.torque(joint)),
            Source::Approach(joint) => of_joint(joint, &|joint| {
                said(Need::Approach, posture.approach(joint))
            }),
            Source::Temperature => {
                let reading = posture.reading;
                let mut links = reading.link_temperatures.iter();
                let own = links.any(|(link, _)| setup.robot.links[*link].body == moved + 1);
                match own || reading.temperature.is_some() {
                    true => posture.temperature(moved + 1),
                    false => constant(f64::NAN),
                }
            }
            Source::Time => said(Need::Time, posture.time()),
            Source::Payload => {
                constant(posture.reading.payload.map_or(0.0, |payload| payload.mass))
            }
        });
        self.law.evaluate(&values.collect::<Vec<S>>())
    }

    /// Refuses laws that change something when all parameters are zero, or that no fit could start from there: tried
    /// at postures all over the joints' ranges.
    fn check_neutral(&self, setup: &Setup) -> Result<(), String> {
        /// Postures tried.
        const POSTURES: usize = 32;
        let ranges = self
            .sources
            .iter()
            .map(|source| match source {
                Source::Angle(joint) => {
                    let joint = joint.find(setup).map(|joint| &setup.robot.joints[joint]);
                    let usual = match joint.map(|joint| joint.kind) {
                        Some(JointKind::Prismatic) => (-1.0, 1.0),
                        _ => (-PI, PI),
                    };
                    joint.and_then(|joint| joint.limits).unwrap_or(usual)
                }
                Source::Torque(_) => (-100.0, 100.0),
                Source::Approach(_) => (-1.0, 1.0),
                Source::Temperature => (-20.0, 20.0),
                Source::Time => (-1e4, 1e4),
                Source::Payload => (0.0, 10.0),
                Source::Parameter(_) => (0.0, 0.0),
            })
            .enumerate();
        // multiples of irrational numbers visit the ranges evenly
        let at = |posture: usize| -> Vec<f64> {
            let share = |k: usize| ((posture + 1) as f64 * ((k * k + 2) as f64).sqrt()).fract();
            let within = |(k, (low, high)): (usize, (f64, f64))| low + (high - low) * share(k);
            ranges.clone().map(within).collect()
        };
        let mut tried = 0;
        let mut sloped = vec![false; self.parameters.len()];
        for posture in 0..POSTURES {
            let numbers = at(posture);
            // one at a time: a slope that is no number would spoil those beside it
            for (parameter, sloped) in sloped.iter_mut().enumerate() {
                let seeds = self.sources.iter().zip(&numbers);
                let values = seeds.map(|(source, &number)| match *source {
                    Source::Parameter(k) if k == parameter => seeded(0.0, 0),
                    _ => constant(number),
                });
                let value: Dual = self.law.evaluate(&values.collect::<Vec<_>>());
                if !value.re.is_finite() {
                    continue;
                }
                if value.re != 0.0 {
                    let shown = self.law.names.iter().zip(&numbers).zip(&self.sources);
                    let shown: Vec<String> = shown
                        .filter(|(_, source)| !matches!(source, Source::Parameter(_)))
                        .map(|((name, number), _)| format!("{} = {number:.3}", name.text))
                        .collect();
                    let place = match shown.is_empty() {
                        true => String::new(),
                        false => format!(" at {}", shown.join(", ")),
                    };
                    let rounded: f64 = format!("{:.3e}", value.re).parse().unwrap_or(value.re);
                    return Err(format!(
                        "with all parameters at zero the law \"{}\" is {rounded}{place}; accepted: laws that are \
                         zero then",
                        self.law.text.escape_debug()
                    ));
                }
                tried += 1;
                *sloped |= rates(&value).is_none_or(|slopes| slopes[0].is_finite());
            }
        }
        if tried == 0 {
            return Err(format!(
                "with all parameters at zero the law \"{}\" has no value at any of {POSTURES} postures; accepted: \
                 laws that are zero then (a width that is divided by is none at zero: tanh(q3*b), not tanh(q3/b))",
                self.law.text.escape_debug()
            ));
        }
        if let Some(k) = sloped.iter().position(|sloped| !sloped) {
            return Err(format!(
                "with all parameters at zero the law \"{}\" has no slope by {}; accepted: laws that a small change \
                 of each parameter changes a little (tanh(q3*b), not tanh(q3/b))",
                self.law.text.escape_debug(),
                self.parameters[k].name
            ));
        }
        Ok(())
    }
}

impl Effect for Expression {
    const ID: &'static str = "expression";
    const STAGE: Stage = Stage::Rigid;

    fn id(&self) -> &str {
        &self.name
    }

    fn stage(&self) -> Stage {
        let reads_torque = |source: &Source| matches!(source, Source::Torque(_));
        if self.sources.iter().any(reads_torque) {
            Stage::Elastic
        } else {
            Stage::Rigid
        }
    }

    fn needs(&self) -> &[Need] {
        &self.needs
    }

    fn distant(&self, setup: &Setup) -> Vec<usize> {
        let torques = self.sources.iter().filter_map(|source| match source {
            Source::Torque(joint) => joint.find(setup),
            _ => None,
        });
        let mut torques: Vec<usize> = torques.collect();
        // q3 and q[elbow] may be the same
        torques.sort_unstable();
        torques.dedup();
        match (&torques[..], self.joint.find(setup)) {
            ([only], Some(moved)) if *only == moved => Vec::new(),
            _ => torques,
        }
    }

    fn check(&self, setup: &Setup) -> Result<(), String> {
        if self.joint.find(setup).is_none() {
            let why = self.joint.unknown(setup);
            return Err(format!("acts_on is \"{}\": {why}", self.acts_on));
        }
        for (name, source) in self.law.names.iter().zip(&self.sources) {
            if let Some(joint) = source.joint()
                && joint.find(setup).is_none()
            {
                let message = joint.unknown(setup);
                return Err(format!("law: {}", self.law.error(name.at, message)));
            }
        }
        self.check_neutral(setup)
    }

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        self.parameters.clone()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let Some(joint) = self.joint.find(posture.setup) else {
            // unchecked, and nowhere to act: no prediction may come of it
            return posture.move_node(0, 0, constant(f64::NAN));
        };
        let by = self.value(p, posture, joint);
        match self.moved {
            Moved::Angle => posture.move_joint(joint, by),
            Moved::Frame(component) => posture.move_node(joint + 1, component, by),
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let find = |joint: &JointName| {
            let unknown = || SpecError::Spec(format!("{}: {}", self.name, joint.unknown(setup)));
            joint.find(setup).ok_or_else(unknown)
        };
        let joint = find(&self.joint)?;
        let place = match self.moved {
            Moved::Angle => joint,
            Moved::Frame(component) => plant.add_drive(joint + 1, component),
        };
        type Told = Box<dyn Fn(&Command, &[f64]) -> f64 + Send + Sync>;
        let mut told: Vec<Told> = Vec::new();
        for source in &self.sources {
            told.push(match source {
                Source::Parameter(index) => {
                    let value = p[*index];
                    Box::new(move |_, _| value)
                }
                Source::Angle(joint) => {
                    let joint = find(joint)?;
                    Box::new(move |command, _| command.joints[joint])
                }
                Source::Torque(joint) => {
                    let joint = find(joint)?;
                    Box::new(move |_, torques| torques[joint])
                }
                Source::Approach(joint) => {
                    let joint = find(joint)?;
                    Box::new(move |command, _| command.approach[joint])
                }
                Source::Temperature => Box::new(|command, _| command.temperature),
                Source::Time => Box::new(|command, _| command.time),
                Source::Payload => {
                    Box::new(|command, _| command.loads.iter().map(|l| l.mass).sum())
                }
            });
        }
        let law = self.law.clone();
        let value = move |command: &Command, torques: &[f64]| {
            let values: Vec<f64> = told.iter().map(|told| told(command, torques)).collect();
            law.value(&values)
        };
        if Effect::stage(self) == Stage::Elastic {
            plant
                .windup_laws
                .push(Arc::new(move |command, torques, angles| {
                    angles[place] += value(command, torques);
                }));
        } else {
            plant.command_laws.push(Arc::new(move |command, angles| {
                angles[place] += value(command, &[]);
            }));
        }
        Ok(())
    }
}
