//! Pictures: curves, bars, maps, points and levels in panels, as SVG and PNG. No robot in it.
//!
//! Drawn once, by plotters, as SVG; the PNG is that SVG rendered by resvg with an embedded font, so both show the same and
//! no machine needs a font. Colours are told apart by people who confuse red and green: the eight of Okabe and Ito (2008,
//! *Color Universal Design*) for lines, viridis for maps.

mod draw;
mod levels;
mod style;

/// A picture of one or more panels.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Lines above everything: what it is, of what.
    pub title: Vec<String>,
    /// Left to right, then down.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
    /// Width and height of a panel, px.
    pub panel_size: (u32, u32),
}

/// One pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Quantity and unit of the horizontal axis.
    pub x: String,
    /// Quantity and unit of the vertical axis.
    pub y: String,
    /// What is in it.
    pub content: Content,
}

/// What a panel shows.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Lines, each with its name in the legend.
    Curves(Vec<Series>),
    /// Groups of bars side by side, from zero.
    Bars {
        /// Below each group.
        labels: Vec<String>,
        /// Names and heights: one height a label.
        series: Vec<(String, Vec<f64>)>,
    },
    /// A value at each point of a grid, by colour; both axes have one scale.
    Map(Map),
    /// Points, and lines over them.
    Scatter {
        /// Below the lines, each kind with its name in the legend.
        dots: Vec<Dots>,
        /// Above them.
        lines: Vec<Series>,
        /// Least and greatest of the vertical axis, where several pictures have one scale; else what is shown.
        heights: Option<(f64, f64)>,
    },
    /// Points with a value each, by colour; both axes have one scale.
    Cloud(Cloud),
    /// Sizes, a row each, on a logarithmic axis.
    Levels(Levels),
}

/// A line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// Points in order; one that is not finite breaks the line.
    pub points: Vec<(f64, f64)>,
    /// Index of its colour.
    pub colour: usize,
    /// Dashed?
    pub dashed: bool,
}

/// Points of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Dots {
    /// In the legend.
    pub name: String,
    /// Those that are not finite are left out.
    pub points: Vec<(f64, f64)>,
    /// Index of their colour.
    pub colour: usize,
}

/// Points with values.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud {
    /// Places and values from zero on.
    pub points: Vec<(f64, f64, f64)>,
    /// Value of the last colour; greater ones have it too.
    pub top: f64,
    /// Quantity and unit of the values.
    pub unit: String,
}

/// Rows of sizes that fall by orders of magnitude.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    /// Names of the rows, downwards.
    pub rows: Vec<String>,
    /// Names and sizes: one a row, none where there is none. The first is drawn as discs, the others as rings.
    pub series: Vec<(String, Vec<Option<f64>>)>,
    /// A size to compare with, and its name.
    pub reference: Option<(String, f64)>,
}

/// Values on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Centres of the columns, ascending.
    pub x: Vec<f64>,
    /// Centres of the rows, ascending.
    pub y: Vec<f64>,
    /// Row by row from the lowest; none is left white.
    pub values: Vec<Option<f64>>,
    /// Quantity and unit of the values.
    pub unit: String,
    /// Value of the last colour; the largest one if none is given.
    pub top: Option<f64>,
}

/// Colour of a share from 0 to 1, as maps have it: red, green, blue.
pub fn colour(share: f64) -> [u8; 3] {
    draw::viridis(share).into()
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[error("the picture cannot be drawn: {0}")]
pub struct PlotError(String);

/// The picture as the text of an SVG file.
///
/// # Errors
/// If a panel has nothing to show, or its numbers are not finite.
pub fn svg(figure: &Figure) -> Result<String, PlotError> {
    draw::figure(figure)
}

/// The picture as the bytes of a PNG file, two pixels for each of the SVG's.
///
/// # Errors
/// As [`svg`].
pub fn png(figure: &Figure) -> Result<Vec<u8>, PlotError> {
    use resvg::{tiny_skia, usvg};
    const SCALE: f32 = 2.0;
    let fail = |error: &dyn std::fmt::Display| PlotError(error.to_string());
    let mut options = usvg::Options::default();
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let tree = usvg::Tree::from_str(&svg(figure)?, &options).map_err(|e| fail(&e))?;
    let size = tree.size();
    let pixels = |length: f32| (length * SCALE).ceil() as u32;
    let mut picture = tiny_skia::Pixmap::new(pixels(size.width()), pixels(size.height()))
        .ok_or_else(|| fail(&"it has no size"))?;
    picture.fill(tiny_skia::Color::WHITE);
    let scale = tiny_skia::Transform::from_scale(SCALE, SCALE);
    resvg::render(&tree, scale, &mut picture.as_mut());
    picture.encode_png().map_err(|e| fail(&e))
}
