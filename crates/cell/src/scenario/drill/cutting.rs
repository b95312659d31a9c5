//! Thrust and torque of a twist drill in a board of layers.
//!
//! Per Shaw and Oxford a drill of diameter `d` at a feed of `f` a revolution in metal of Brinell hardness `H` needs
//!
//! `thrust / (d² H) = 0.195 f^0.8 / d^1.2 + 0.0022`, `torque / (d³ H) = 0.087 f^0.8 / d^1.2`
//!
//! with lengths in inches, for chisel edges of 0.18 diameters. The first part of the thrust and the torque are the lips', the
//! second is the chisel edge's, which does not cut but presses: it is there at the smallest feed. Laminates of glass and
//! epoxy follow the same form (Okutan et al.); their `H` is that of a metal that would need as much.
//!
//! The point is a cone: while it enters, leaves, or stands in two layers at once, each part of the lips counts with the
//! layer that it is in, and the chisel edge with the one at the tip. So thrust falls off once the tip is through.
//!
//! Sources: Shaw, Oxford 1957, *On the drilling of metals, 2: the torque and thrust in drilling*, Trans. ASME 79, 139-148;
//! Okutan, Karabay, Sınmazçelik, Avcu 2013, *A study on the derivation of parametric cutting force equations in drilling of
//! GFRP composites*, Strojniški vestnik 59(2), 97-105.

use std::f64::consts::PI;

const INCH: f64 = 0.0254;
/// Thrust of the lips, inches.
const LIPS: f64 = 0.195;
/// Thrust of the chisel edge.
const CHISEL: f64 = 0.0022;
/// Torque, inches.
const TORQUE: f64 = 0.087;
/// Length of the chisel edge, diameters.
const CHISEL_LENGTH: f64 = 0.18;
/// Young's modulus of cemented carbide with 6 to 10 % cobalt, N/m².
const CARBIDE: f64 = 6.0e11;
/// Bending stress at which cemented carbide of fine grain breaks, N/m² (ISO 3327: 3 to 4 GPa).
pub const RUPTURE: f64 = 3.5e9;
/// Second moment of area of a fluted section over that of the full circle.
const FLUTED: f64 = 0.5;

/// A twist drill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drill {
    /// m.
    pub diameter: f64,
    /// Whole angle of the point, rad.
    pub point_angle: f64,
    /// From the chuck to the tip, m.
    pub length: f64,
    /// Revolutions a second.
    pub speed: f64,
}

/// A layer of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// m.
    pub thickness: f64,
    /// Brinell hardness as a pressure, N/m².
    pub hardness: f64,
}

/// What a drill needs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Need {
    /// Along the axis, N.
    pub thrust: f64,
    /// About it, N·m.
    pub torque: f64,
}

impl Drill {
    /// Height of the point's cone, m.
    pub fn cone(&self) -> f64 {
        self.diameter / 2.0 / (self.point_angle / 2.0).tan()
    }

    /// Lateral stiffness of the drill as a beam clamped in the chuck, bent where it enters the board at a depth of the tip,
    /// N/m: `3 E I / L³`.
    pub fn lateral_stiffness(&self, depth: f64) -> f64 {
        let free = (self.length - depth.max(0.0)).max(self.diameter);
        3.0 * CARBIDE * self.area_moment() / free.powi(3)
    }

    /// Thrust under which it buckles, clamped in the chuck and held by the board, N: `20.19 E I / L²` (Euler).
    pub fn buckling_load(&self) -> f64 {
        20.19 * CARBIDE * self.area_moment() / self.length.powi(2)
    }

    /// Bending stress in the chuck under a lateral force (N) where the drill enters the board, N/m².
    pub fn bending_stress(&self, force: f64, depth: f64) -> f64 {
        let lever = (self.length - depth.max(0.0)).max(0.0);
        force * lever * self.diameter / 2.0 / self.area_moment()
    }

    /// Second moment of area of the fluted section, m⁴.
    fn area_moment(&self) -> f64 {
        FLUTED * PI * self.diameter.powi(4) / 64.0
    }

    /// Thrust and torque with the tip so deep in the board, at a feed a revolution, m; none for a feed of zero or less.
    pub fn need(&self, layers: &[Layer], depth: f64, feed: f64) -> Need {
        if feed <= 0.0 {
            return Need::default();
        }
        let (d, radius) = (self.diameter, self.diameter / 2.0);
        let chisel = CHISEL_LENGTH * radius;
        let slope = (self.point_angle / 2.0).tan();
        let form = feed.powf(0.8) / d.powf(1.2) * INCH.powf(0.4);
        let mut need = Need::default();
        let mut top = 0.0;
        for layer in layers {
            let bottom = top + layer.thickness;
            if (top..bottom).contains(&depth) {
                need.thrust += CHISEL * d * d * layer.hardness;
            }
            // the edge at a radius r is r / slope behind the tip
            let from = ((depth - bottom) * slope).clamp(chisel, radius);
            let to = ((depth - top) * slope).clamp(chisel, radius);
            need.thrust += LIPS * form * d * d * layer.hardness * (to - from) / (radius - chisel);
            let lever = (to * to - from * from) / (radius * radius - chisel * chisel);
            need.torque += TORQUE * form * d.powi(3) * layer.hardness * lever;
            top = bottom;
        }
        need
    }
}

/// Thickness of all layers, m.
pub fn thickness(layers: &[Layer]) -> f64 {
    layers.iter().map(|layer| layer.thickness).sum()
}
