//! Colours, sizes and room of all panels.

use super::PlotError;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::SVGBackend;
use plotters::style::RGBColor;

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Okabe and Ito's colours that are dark enough on white.
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
];
pub(super) const GREY: RGBColor = RGBColor(90, 90, 90);
pub(super) const LABEL: u32 = 13;
/// Room for the numbers beside a vertical axis, below a horizontal one, and for a panel's title, px.
pub(super) const LEFT: u32 = 62;
pub(super) const BELOW: u32 = 42;
pub(super) const ABOVE: u32 = 26;
pub(super) const MARGIN: u32 = 8;
/// Room for the scale of a map, px.
pub(super) const SCALE: u32 = 78;

pub(super) fn failed(error: impl std::fmt::Display) -> PlotError {
    PlotError(error.to_string())
}
