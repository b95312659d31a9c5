//! Drill and board in contact: which wrench they exert on each other in one moment, in the plant's own equilibrium.
//!
//! Both arms give way under it, so depth and feed, on which it depends, depend on it: it is sought by Newton's method on
//! MuJoCo's static states, with a tangent of the two arms' compliance at the hole.

use super::cutting::{Drill, Layer, Need};
use crate::plant::{Command, Load, Plant, PlantError, PlantSpec, State};
use nalgebra::{Isometry3, Matrix2, Matrix3, Point3, Vector2, Vector3};

/// What meets, and where.
#[derive(Clone)]
pub struct Contact<'a> {
    /// The truth.
    pub spec: &'a PlantSpec,
    /// Target that is the board: origin on the surface, z out of it towards the drill.
    pub board: usize,
    /// Target that is the drill: origin at the tip, z along the feed.
    pub tool: usize,
    /// The drill.
    pub drill: &'a Drill,
    /// The board, from the side of the drill.
    pub layers: &'a [Layer],
    /// Duration of a tick, s.
    pub tick: f64,
    /// How depth (m) and the place where the axis meets the board (m, board's x and y) answer to thrust and lateral
    /// force on the drill (N).
    compliance: Matrix3<f64>,
}

/// What the hole remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hole {
    /// Depth of the tip, m.
    pub depth: f64,
    /// Where it was started, board's x and y, m.
    pub mouth: Option<Vector2<f64>>,
}

/// Where drill and board are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Depth of the undeformed tip below the surface, m.
    pub depth: f64,
    /// Where the drill's axis meets the surface, board's x and y, m.
    pub meets: Vector2<f64>,
    /// Direction of the drill's axis, in the board's frame.
    pub axis: Vector3<f64>,
    /// Pose of the board.
    pub base_from_board: Isometry3<f64>,
}

impl Geometry {
    /// Angle between axis and normal, rad.
    pub fn tilt(&self) -> f64 {
        self.axis.xy().norm().atan2(-self.axis.z)
    }
}

/// One moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// The robot.
    pub state: State,
    /// Where drill and board are.
    pub geometry: Geometry,
    /// Thrust and torque.
    pub need: Need,
    /// Lateral force on the drill, board's x and y, N.
    pub lateral: Vector2<f64>,
}

/// Thrust and lateral force on the drill.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Wanted {
    need: Need,
    lateral: Vector2<f64>,
}

/// Forces that change by less than this are settled, N.
const SETTLED: f64 = 1e-9;
const ITERATIONS: usize = 50;

impl<'a> Contact<'a> {
    /// Measures the compliance at the hole, in the plant under a command.
    ///
    /// # Errors
    /// If the arms do not hold.
    pub fn new(
        spec: &'a PlantSpec,
        (board, tool): (usize, usize),
        (drill, layers): (&'a Drill, &'a [Layer]),
        tick: f64,
        plant: &mut Plant,
        command: &Command,
    ) -> Result<Self, PlantError> {
        let mut contact = Self {
            spec,
            board,
            tool,
            drill,
            layers,
            tick,
            compliance: Matrix3::zeros(),
        };
        let free = contact.press(plant, command, None)?;
        let at = |g: &Geometry| Vector3::new(g.depth, g.meets.x, g.meets.y);
        let rest = at(&contact.geometry(&free));
        for k in 0..3 {
            let unit = Vector3::ith(k, 1.0);
            let wanted = Wanted {
                need: Need {
                    thrust: unit[0],
                    torque: 0.0,
                },
                lateral: Vector2::new(unit[1], unit[2]),
            };
            let geometry = contact.geometry(&free);
            let pressed = contact.press(plant, command, Some((&wanted, &geometry, &free)))?;
            let moved = at(&contact.geometry(&pressed)) - rest;
            contact.compliance.set_column(k, &moved);
        }
        Ok(contact)
    }

    /// Where drill and board are in a state.
    pub fn geometry(&self, state: &State) -> Geometry {
        let pose = |target: usize| state.base_from_link[target] * self.spec.targets[target].1;
        let base_from_board = pose(self.board);
        let board_from_tool = base_from_board.inverse() * pose(self.tool);
        let tip = board_from_tool.translation.vector;
        let axis = board_from_tool.rotation * Vector3::z();
        let meets = tip - axis * (tip.z / axis.z);
        Geometry {
            depth: -tip.z,
            meets: meets.xy(),
            axis,
            base_from_board,
        }
    }

    /// The plant under a command and a wrench between drill and board, applied where the axis met the surface in the state
    /// before.
    fn press(
        &self,
        plant: &mut Plant,
        command: &Command,
        wrench: Option<(&Wanted, &Geometry, &State)>,
    ) -> Result<State, PlantError> {
        let Some((wanted, geometry, before)) = wrench else {
            return plant.state(command);
        };
        let turn = geometry.base_from_board.rotation;
        let axis = turn * geometry.axis;
        let sideways = turn * Vector3::new(wanted.lateral.x, wanted.lateral.y, 0.0);
        let force = sideways - axis * wanted.need.thrust;
        // a right-hand drill turns about its feed; the board holds it back
        let moment = -axis * wanted.need.torque;
        let meets = Point3::new(geometry.meets.x, geometry.meets.y, 0.0);
        let point = geometry.base_from_board * meets;
        let on = |target: usize, sign: f64| Load {
            target,
            mass: 0.0,
            com: (before.base_from_link[target].inverse() * point).coords,
            pull: force * sign,
            moment: moment * sign,
        };
        let mut command = command.clone();
        command.loads.push(on(self.tool, 1.0));
        command.loads.push(on(self.board, -1.0));
        plant.state(&command)
    }

    /// The robot at rest under a command, with the drill where the hole and the feed since the tick before allow; the
    /// hole is deepened.
    ///
    /// # Errors
    /// If the arms do not hold.
    pub fn advance(
        &self,
        plant: &mut Plant,
        command: &Command,
        hole: &mut Hole,
    ) -> Result<Moment, PlantError> {
        let mut state = self.press(plant, command, None)?;
        let mut geometry = self.geometry(&state);
        let mut wanted = Wanted::default();
        for _ in 0..ITERATIONS {
            let next = self.wanted(&geometry, &wanted, hole);
            let change = (next.need.thrust - wanted.need.thrust).abs()
                + (next.lateral - wanted.lateral).norm()
                + (next.need.torque - wanted.need.torque).abs() / self.drill.diameter;
            wanted = next;
            if change < SETTLED {
                break;
            }
            state = self.press(plant, command, Some((&wanted, &geometry, &state)))?;
            geometry = self.geometry(&state);
        }
        hole.depth = hole.depth.max(geometry.depth);
        if hole.mouth.is_none() && hole.depth >= self.drill.cone() {
            let bent = wanted.lateral / self.drill.lateral_stiffness(hole.depth);
            hole.mouth = Some(geometry.meets + bent);
        }
        Ok(Moment {
            state,
            geometry,
            need: wanted.need,
            lateral: wanted.lateral,
        })
    }

    /// The wrench that fits to where drill and board would be under it, along the tangent from where they are now under
    /// the wrench `at`.
    fn wanted(&self, now: &Geometry, at: &Wanted, hole: &Hole) -> Wanted {
        let c = &self.compliance;
        let stiffness = self.drill.lateral_stiffness(now.depth);
        // the surface pushes along its normal: on a slanted one, sideways against the axis, until the cone is in
        let skid = -now.axis.xy() / now.axis.z;
        let lateral = |thrust: f64| -> Vector2<f64> {
            let more = thrust - at.need.thrust;
            match hole.mouth {
                // a bent drill: l = k (mouth - meets(thrust, l))
                Some(mouth) => {
                    let own = c.fixed_view::<2, 2>(1, 1);
                    let gap =
                        mouth - now.meets - c.fixed_view::<2, 1>(1, 0) * more + own * at.lateral;
                    let matrix = Matrix2::identity() + own * stiffness;
                    matrix
                        .try_inverse()
                        .map_or(at.lateral, |m| m * gap * stiffness)
                }
                None => skid * thrust,
            }
        };
        let depth = |thrust: f64, lateral: &Vector2<f64>| -> f64 {
            let by = lateral - at.lateral;
            now.depth + c[(0, 0)] * (thrust - at.need.thrust) + c[(0, 1)] * by.x + c[(0, 2)] * by.y
        };
        let revolutions = self.drill.speed * self.tick;
        let need = |thrust: f64| -> Need {
            let depth = depth(thrust, &lateral(thrust));
            let feed = (depth - hole.depth) / revolutions;
            self.drill.need(self.layers, depth, feed)
        };
        // what is needed falls as the thrust that is there grows: the two meet once
        let (mut low, mut high) = (0.0, at.need.thrust.max(1.0));
        while need(high).thrust > high && high < 1e6 {
            high *= 2.0;
        }
        while high - low > 1e-12 * high {
            let middle = (low + high) / 2.0;
            if middle <= low || middle >= high {
                break;
            }
            match need(middle).thrust > middle {
                true => low = middle,
                false => high = middle,
            }
        }
        // a drill that does not touch, or a chisel edge that does not yet go in, bears what it is pressed with
        let thrust = if need(0.0).thrust > 0.0 { low } else { 0.0 };
        Wanted {
            need: Need {
                thrust,
                torque: need(thrust).torque,
            },
            lateral: lateral(thrust),
        }
    }
}
