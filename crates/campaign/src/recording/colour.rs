//! Colours of points in a recording.

use plotters::style::RGBColor;
use plotters::style::colors::colormaps::ViridisRGB;

/// Colour of a share from 0 to 1 by viridis, as maps have it: red, green, blue.
pub(super) fn colour(share: f64) -> [u8; 3] {
    let RGBColor(red, green, blue) = ViridisRGB::get_color_normalized(share, 0.0, 1.0);
    [red, green, blue]
}
