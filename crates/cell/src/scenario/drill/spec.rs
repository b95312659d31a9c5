//! `[drill]` of a scenario: its keys, what they may be, and in SI units.

use super::super::control_loop::FilterEntry;
use super::super::tool::{Tool, check_target};
use super::cutting::{self, Drill, Layer};
use crate::compensation::filter::Law;
use crate::numbers::number;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Brinell hardness of 1 kgf/mm² as a pressure, N/m².
const BRINELL: f64 = 9.80665e6;
/// Ticks of one hole: a typing error must not cost a day.
const MAX_TICKS: f64 = 200_000.0;

/// `[drill]` of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
pub struct Drilling {
    /// Target that is the board: origin in the middle of the surface, z out of it towards the drill.
    pub board: String,
    /// Target that is the drill: origin at the tip, z along the feed.
    pub tool: String,
    /// Where the hole is to be, in the base frame, m.
    pub hole_m: [f64; 3],
    /// Direction of the feed, in the base frame.
    pub feed: [f64; 3],
    /// Where the hole is to be on the board, from its middle, mm.
    #[serde(default)]
    pub place_mm: [f64; 2],
    /// The board's edges along its x and y, mm.
    #[serde(default = "board_size")]
    pub size_mm: [f64; 2],
    /// Turn of the board about its normal, deg; at 0 its x axis points up.
    #[serde(default)]
    pub board_turn_deg: f64,
    /// Turn of the drill's arm about the feed, deg; at 0 its x axis points up.
    #[serde(default)]
    pub tool_turn_deg: f64,
    /// Board and what it is mounted with, in the link's frame.
    #[serde(default)]
    pub board_load: Tool,
    /// Spindle, in the link's frame.
    #[serde(default)]
    pub tool_load: Tool,
    /// Layers from the side of the drill.
    pub layer: Vec<LayerEntry>,
    /// Drill: diameter, mm.
    pub diameter_mm: f64,
    /// Whole angle of its point, deg.
    #[serde(default = "point_angle")]
    pub point_angle_deg: f64,
    /// From the chuck to the tip, mm.
    pub length_mm: f64,
    /// Spindle speed, 1/min.
    pub speed_rpm: f64,
    /// Feed per revolution, µm.
    pub feed_um: f64,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Before the tip touches, s.
    #[serde(default = "half")]
    pub approach_s: f64,
    /// After the drill is through, s.
    #[serde(default = "half")]
    pub after_s: f64,
    /// How commands are made, each a hole of its own.
    #[serde(default = "all_modes", rename = "commands")]
    pub modes: Vec<Mode>,
    /// Model that corrects, as for `[compensate]`.
    #[serde(default = "default_model")]
    pub model: String,
    /// Filter of the loop, if one of the commands is.
    pub filter: Option<FilterEntry>,
}

fn board_size() -> [f64; 2] {
    [200.0, 150.0]
}

fn point_angle() -> f64 {
    130.0
}

fn half() -> f64 {
    0.5
}

fn all_modes() -> Vec<Mode> {
    vec![Mode::Nominal, Mode::Corrected, Mode::Loop]
}

fn default_model() -> String {
    "default".to_owned()
}

/// `[[drill.layer]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
pub struct LayerEntry {
    /// mm.
    pub thickness_mm: f64,
    /// Brinell hardness of a metal that needs as much thrust, kgf/mm².
    pub hardness_HB: f64,
}

/// How commands are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// By the nominal robot, standing where the fit says.
    Nominal,
    /// Corrected for all that the model holds, under the tools' weights.
    Corrected,
    /// The same, and for what the wrist sensors feel, tick by tick.
    Loop,
}

impl Mode {
    /// Its name everywhere.
    pub fn word(self) -> &'static str {
        match self {
            Mode::Nominal => "nominal",
            Mode::Corrected => "corrected",
            Mode::Loop => "loop",
        }
    }
}

impl Drilling {
    /// Refuses what makes no sense for a robot.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, setup: &Setup) -> Result<(), String> {
        self.check_targets(setup)?;
        self.check_place()?;
        self.check_cut()?;
        self.check_ticks()?;
        if self.modes.is_empty() {
            return wrong("commands is empty; accepted: nominal, corrected, loop".to_owned());
        }
        if (1..self.modes.len()).any(|k| self.modes[..k].contains(&self.modes[k])) {
            return wrong("commands has one of them twice; accepted: each once".to_owned());
        }
        self.law().map(|_| ())
    }

    /// Board and tool: targets on two arms.
    fn check_targets(&self, setup: &Setup) -> Result<(), String> {
        check_target("[drill] board", &self.board, setup)?;
        check_target("[drill] tool", &self.tool, setup)?;
        if self.board == self.tool {
            return wrong("board and tool are one target; accepted: one on each arm".to_owned());
        }
        let body = |name: &str| {
            let found = setup.targets.iter().find(|t| t.name == name);
            found.map_or(0, |t| setup.robot.links[t.link].body)
        };
        let chains = [body(&self.board), body(&self.tool)].map(|body| setup.robot.chain(body));
        let own = |a: usize, b: usize| chains[a].iter().any(|joint| !chains[b].contains(joint));
        match own(0, 1) && own(1, 0) {
            true => Ok(()),
            false => wrong(format!(
                "board \"{}\" and tool \"{}\" hang on one arm; accepted: targets on two",
                self.board, self.tool
            )),
        }
    }

    /// Where the hole is to be, on a board of some size, and what hangs on the arms.
    fn check_place(&self) -> Result<(), String> {
        let turns = [self.board_turn_deg, self.tool_turn_deg];
        let mut numbers = self.hole_m.iter().chain(&self.place_mm).chain(&turns);
        if let Some(found) = numbers.find(|x| !x.is_finite()) {
            return wrong(format!(
                "{found} among hole_m, place_mm, board_turn_deg and tool_turn_deg; accepted: finite numbers"
            ));
        }
        if !(Vector3::from(self.feed).norm() > 1e-6 && Vector3::from(self.feed).norm() < 1e6) {
            return wrong(format!(
                "feed is {:?}; accepted: a direction, any vector from 1e-6 to 1e6 long",
                self.feed
            ));
        }
        if self.size_mm.iter().any(|x| !(*x > 0.0 && *x <= 1e4)) {
            return wrong(format!(
                "size_mm is {:?}; accepted: two edges above 0, up to 10000",
                self.size_mm
            ));
        }
        for (axis, (place, size)) in self.place_mm.iter().zip(&self.size_mm).enumerate() {
            if place.abs() >= size / 2.0 {
                return wrong(format!(
                    "place_mm[{axis}] is {place}, off the board; accepted: above {} and below {}",
                    -size / 2.0,
                    size / 2.0
                ));
            }
        }
        self.board_load.check("[drill] board_load")?;
        self.tool_load.check("[drill] tool_load")
    }

    /// Layers, drill, feed and times.
    fn check_cut(&self) -> Result<(), String> {
        if self.layer.is_empty() {
            return wrong("has no [[drill.layer]]; accepted: one or more".to_owned());
        }
        let within = |key: &str, value: f64, least: f64, most: f64| {
            if value >= least && value <= most {
                return Ok(());
            }
            let (least, most) = (number(least), number(most));
            wrong(format!("{key} is {value}; accepted: {least} to {most}"))
        };
        for layer in &self.layer {
            within("layer: thickness_mm", layer.thickness_mm, 1e-3, 50.0)?;
            within("layer: hardness_HB", layer.hardness_HB, 0.1, 1000.0)?;
        }
        within("diameter_mm", self.diameter_mm, 0.05, 20.0)?;
        within("point_angle_deg", self.point_angle_deg, 60.0, 175.0)?;
        within("speed_rpm", self.speed_rpm, 1.0, 1e6)?;
        within("feed_um", self.feed_um, 1e-3, 1000.0)?;
        within("rate_hz", self.rate_hz, 10.0, 10_000.0)?;
        within("approach_s", self.approach_s, 0.1, 10.0)?;
        within("after_s", self.after_s, 0.0, 10.0)?;
        let least = (self.depth() * 1e3 + self.diameter_mm).min(500.0);
        within("length_mm", self.length_mm, least, 500.0)
    }

    /// Ticks short enough for point and layers, and not too many of them.
    fn check_ticks(&self) -> Result<(), String> {
        let layers = self.layers();
        let thinnest = layers.iter().fold(f64::INFINITY, |a, b| a.min(b.thickness));
        let step = (self.drill().cone() / 10.0).min(thinnest / 2.0);
        let rate = self.feed_rate() / step;
        if self.rate_hz < rate {
            return wrong(format!(
                "rate_hz is {}: the drill would advance {} µm a tick; accepted: {} or more, for a tenth of its point and \
                 half of the thinnest layer",
                self.rate_hz,
                number(self.feed_rate() / self.rate_hz * 1e6),
                rate.ceil()
            ));
        }
        let ticks = self.duration() * self.rate_hz;
        match ticks > MAX_TICKS {
            false => Ok(()),
            true => wrong(format!(
                "asks for {ticks:.0} ticks; accepted: at most {MAX_TICKS}, by a faster feed or a lower rate"
            )),
        }
    }

    /// The loop's filter.
    pub(super) fn law(&self) -> Result<Law, String> {
        match &self.filter {
            Some(filter) => filter.law("[drill] filter", self.rate_hz),
            None if self.modes.contains(&Mode::Loop) => Err(
                "[drill] filter is missing; accepted for commands = [\"loop\"]: { kind = \"none\" }, or another as for \
                 [[loop.filter]]"
                    .to_owned(),
            ),
            None => Ok(Law::none()),
        }
    }

    /// How deep the tip is sent, m: through, with its whole cone, and as much again for what the arms give way.
    pub(super) fn depth(&self) -> f64 {
        cutting::thickness(&self.layers()) + 2.0 * self.drill().cone()
    }

    /// The drill, SI.
    pub fn drill(&self) -> Drill {
        Drill {
            diameter: self.diameter_mm * 1e-3,
            point_angle: self.point_angle_deg.to_radians(),
            length: self.length_mm * 1e-3,
            speed: self.speed_rpm / 60.0,
        }
    }

    /// The board, SI.
    pub fn layers(&self) -> Vec<Layer> {
        let layers = self.layer.iter();
        layers
            .map(|layer| Layer {
                thickness: layer.thickness_mm * 1e-3,
                hardness: layer.hardness_HB * BRINELL,
            })
            .collect()
    }

    /// Feed, m/s.
    pub fn feed_rate(&self) -> f64 {
        self.feed_um * 1e-6 * self.speed_rpm / 60.0
    }

    /// How long a hole takes, s.
    pub(super) fn duration(&self) -> f64 {
        self.approach_s + self.depth() / self.feed_rate() + self.after_s
    }
}

fn wrong(what: String) -> Result<(), String> {
    Err(format!("[drill] {what}"))
}
