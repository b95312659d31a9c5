//! From a figure to the text of an SVG file.

use super::style::*;
use super::{Cloud, Content, Dots, Figure, Map, Panel, PlotError, Series, levels};
use plotters::chart::{ChartBuilder, ChartContext, SeriesLabelPosition};
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::IntoDrawingArea;
use plotters::element::{Circle, PathElement, Rectangle};
use plotters::prelude::SVGBackend;
use plotters::series::{DashedLineSeries, LineSeries};
use plotters::style::colors::colormaps::ViridisRGB;
use plotters::style::colors::{BLACK, WHITE};
use plotters::style::{Color, IntoFont, RGBColor, ShapeStyle, TextStyle};
use std::ops::Range;

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
const TITLE: u32 = 17;

pub(super) fn figure(figure: &Figure) -> Result<String, PlotError> {
    let columns = figure.columns.clamp(1, figure.panels.len().max(1));
    let rows = figure.panels.len().div_ceil(columns);
    let title = 2 * MARGIN + (TITLE + 4) * figure.title.len() as u32;
    let (width, height) = figure.panel_size;
    let size = (width * columns as u32, title + height * rows as u32);
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (head, body) = root.split_vertically(title);
        for (line, words) in figure.title.iter().enumerate() {
            let font = if line == 0 { TITLE } else { LABEL + 1 };
            let style = TextStyle::from(("sans-serif", font).into_font());
            let style = style.color(if line == 0 { &BLACK } else { &GREY });
            let at = (16, (MARGIN + (TITLE + 4) * line as u32) as i32);
            head.draw_text(words, &style, at).map_err(failed)?;
        }
        let areas = body.split_evenly((rows, columns));
        for (panel, area) in figure.panels.iter().zip(&areas) {
            self::panel(panel, area)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(text)
}

fn panel(panel: &Panel, area: &Area<'_>) -> Result<(), PlotError> {
    match &panel.content {
        Content::Curves(series) => curves(panel, series, area),
        Content::Bars { labels, series } => bars(panel, labels, series, area),
        Content::Map(map) => self::map(panel, map, area),
        Content::Scatter {
            dots,
            lines,
            heights,
        } => scatter(panel, (dots, lines), *heights, area),
        Content::Cloud(cloud) => self::cloud(panel, cloud, area),
        Content::Levels(found) => levels::draw(panel, found, area),
    }
}

/// Least and greatest of finite numbers, with room around them; `zero` is inside if so wanted.
fn range(values: impl Iterator<Item = f64>, zero: bool) -> Result<Range<f64>, PlotError> {
    let start = if zero {
        (0.0, 0.0)
    } else {
        (f64::INFINITY, f64::NEG_INFINITY)
    };
    let (least, most) = values
        .filter(|x| x.is_finite())
        .fold(start, |(a, b), x| (a.min(x), b.max(x)));
    if least > most {
        return Err(failed("a panel has no number to show"));
    }
    let room = if most > least {
        0.06 * (most - least)
    } else {
        most.abs().max(1e-12) * 0.1
    };
    Ok(least - if zero && least == 0.0 { 0.0 } else { room }..most + room)
}

/// Room above what is shown, where the legend stands.
fn under_legend(range: Range<f64>, entries: usize, area: &Area<'_>) -> Range<f64> {
    let height = area.dim_in_pixel().1;
    let inside = f64::from(height.saturating_sub(BELOW + ABOVE + 2 * MARGIN).max(1));
    let legend = if entries > 0 { 16 + 22 * entries } else { 0 };
    let share = (legend as f64 / inside).min(0.6);
    range.start..range.end + (range.end - range.start) * share / (1.0 - share)
}

fn axes<'a, 'b>(
    panel: &Panel,
    area: &'a Area<'b>,
    (x, y): (Range<f64>, Range<f64>),
    right: u32,
) -> Result<Chart<'a, 'b>, PlotError> {
    ChartBuilder::on(area)
        .caption(&panel.title, ("sans-serif", LABEL + 2))
        .margin(MARGIN)
        .margin_right(MARGIN + right)
        .x_label_area_size(BELOW)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(x, y)
        .map_err(failed)
}

/// A number on an axis whose whole length is `span`: as many decimals as tell its marks apart.
fn mark(value: &f64, span: f64) -> String {
    let decimals = (1.0 - span.abs().max(1e-300).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.decimals$}");
    // minus zero is zero
    if text.trim_start_matches(['-', '0', '.']).is_empty() {
        return text.trim_start_matches('-').to_owned();
    }
    text
}

fn mesh(
    chart: &mut Chart<'_, '_>,
    panel: &Panel,
    (x, y): (f64, f64),
    labels: Option<&[String]>,
) -> Result<(), PlotError> {
    let on_x = |value: &f64| match labels {
        None => mark(value, x),
        Some(labels) => {
            let index = value.round();
            let near = (value - index).abs() < 1e-6 && index >= 0.0;
            near.then(|| labels.get(index as usize).cloned())
                .flatten()
                .unwrap_or_default()
        }
    };
    let on_y = |value: &f64| mark(value, y);
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(panel.x.as_str())
        .y_desc(panel.y.as_str())
        .axis_style(GREY)
        .bold_line_style(BLACK.mix(0.10))
        .light_line_style(BLACK.mix(0.0))
        .label_style(("sans-serif", LABEL))
        .axis_desc_style(("sans-serif", LABEL))
        .x_labels(labels.map_or(7, |labels| 2 * labels.len()))
        .y_labels(7)
        .x_label_formatter(&on_x)
        .y_label_formatter(&on_y);
    if labels.is_some() {
        mesh.disable_x_mesh();
    }
    mesh.draw().map_err(failed)
}

fn legend<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>) -> Result<(), PlotError> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.15))
        .label_font(("sans-serif", LABEL))
        .margin(6)
        .draw()
        .map_err(failed)
}

fn curves(panel: &Panel, all: &[Series], area: &Area<'_>) -> Result<(), PlotError> {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let points = || {
        all.iter()
            .flat_map(|series| &series.points)
            .filter(|p| finite(p))
    };
    let least = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let most = points().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    let x = match most > least {
        true => least..most,
        false => range(points().map(|p| p.0), false)?,
    };
    let named = all.iter().any(|series| !series.name.is_empty());
    let entries = all.iter().filter(|series| !series.name.is_empty()).count();
    let y = under_legend(range(points().map(|p| p.1), false)?, entries, area);
    let spans = (x.end - x.start, y.end - y.start);
    let mut chart = axes(panel, area, (x, y), 0)?;
    mesh(&mut chart, panel, spans, None)?;
    lines(&mut chart, all)?;
    match named {
        true => legend(&mut chart),
        false => Ok(()),
    }
}

/// Lines, each broken where it is not finite.
fn lines(chart: &mut Chart<'_, '_>, all: &[Series]) -> Result<(), PlotError> {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    for series in all {
        let style = ShapeStyle::from(COLOURS[series.colour % COLOURS.len()]).stroke_width(2);
        let mut labelled = false;
        for part in series.points.split(|p| !finite(p)) {
            if part.is_empty() {
                continue;
            }
            let part = part.iter().copied();
            let drawn = match series.dashed {
                true => chart.draw_series(DashedLineSeries::new(part, 6, 4, style)),
                false => chart.draw_series(LineSeries::new(part, style)),
            };
            let drawn = drawn.map_err(failed)?;
            if !labelled && !series.name.is_empty() {
                labelled = true;
                let step = if series.dashed { 9 } else { 18 };
                drawn
                    .label(&series.name)
                    .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + step, y)], style));
            }
        }
    }
    Ok(())
}

/// Radius of a point, px.
const DOT: i32 = 3;
/// More points than these hide each other.
const MANY: usize = 150;

fn scatter(
    panel: &Panel,
    (dots, through): (&[Dots], &[Series]),
    heights: Option<(f64, f64)>,
    area: &Area<'_>,
) -> Result<(), PlotError> {
    let finite = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let points = || {
        let dots = dots.iter().flat_map(|dots| &dots.points);
        let lines = through.iter().flat_map(|series| &series.points);
        dots.chain(lines).filter(finite)
    };
    let mut names = dots.iter().map(|dots| &dots.name);
    let named = names.any(|name| !name.is_empty()) || through.iter().any(|s| !s.name.is_empty());
    let x = range(points().map(|p| p.0), false)?;
    let held = heights.into_iter().flat_map(|(least, most)| [least, most]);
    let y = range(points().map(|p| p.1).chain(held), false)?;
    let names = dots
        .iter()
        .map(|dots| &dots.name)
        .chain(through.iter().map(|s| &s.name));
    let entries = names.filter(|name| !name.is_empty()).count();
    // pictures of one scale have the same room above, whatever their legends
    let entries = match heights {
        Some(_) => entries.max(2),
        None => entries,
    };
    let y = under_legend(y, entries, area);
    let spans = (x.end - x.start, y.end - y.start);
    let mut chart = axes(panel, area, (x, y), 0)?;
    mesh(&mut chart, panel, spans, None)?;
    for dots in dots {
        let style = COLOURS[dots.colour % COLOURS.len()].mix(0.55).filled();
        let points = dots.points.iter().filter(finite).copied();
        let drawn = chart.draw_series(points.map(|at| Circle::new(at, DOT, style)));
        let drawn = drawn.map_err(failed)?;
        if !dots.name.is_empty() {
            let mark = move |(x, y)| Circle::new((x + 9, y), DOT, style);
            drawn.label(&dots.name).legend(mark);
        }
    }
    lines(&mut chart, through)?;
    match named {
        true => legend(&mut chart),
        false => Ok(()),
    }
}

fn bars(
    panel: &Panel,
    labels: &[String],
    all: &[(String, Vec<f64>)],
    area: &Area<'_>,
) -> Result<(), PlotError> {
    let heights = || all.iter().flat_map(|(_, heights)| heights.iter().copied());
    let named = all.iter().any(|(name, _)| !name.is_empty());
    let entries = if named { all.len() } else { 0 };
    let y = under_legend(range(heights(), true)?, entries, area);
    let x = -0.6..labels.len() as f64 - 0.4;
    let spans = (x.end - x.start, y.end - y.start);
    let mut chart = axes(panel, area, (x, y), 0)?;
    mesh(&mut chart, panel, spans, Some(labels))?;
    let width = 0.8 / all.len().max(1) as f64;
    for (index, (name, heights)) in all.iter().enumerate() {
        let style = COLOURS[index % COLOURS.len()].filled();
        let left = |group: usize| group as f64 - 0.4 + width * index as f64;
        let finite = heights.iter().enumerate().filter(|(_, h)| h.is_finite());
        let bars = finite.map(|(group, height)| {
            let corners = [(left(group), 0.0), (left(group) + 0.92 * width, *height)];
            Rectangle::new(corners, style)
        });
        chart
            .draw_series(bars)
            .map_err(failed)?
            .label(name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], style));
    }
    match named {
        true => legend(&mut chart),
        false => Ok(()),
    }
}

/// Half of the distance between neighbours: a cell reaches so far around its centre.
fn half(centres: &[f64]) -> f64 {
    match centres {
        [first, .., last] if centres.len() > 1 => (last - first) / (centres.len() - 1) as f64 / 2.0,
        _ => 0.5,
    }
}

/// One scale for both axes beside a bar of colours: the shorter one is given more room.
fn alike((x, y): (&mut Range<f64>, &mut Range<f64>), area: &Area<'_>) {
    let (width, height) = area.dim_in_pixel();
    let inside = (
        f64::from(width.saturating_sub(LEFT + SCALE + 2 * MARGIN)),
        f64::from(height.saturating_sub(BELOW + ABOVE + 2 * MARGIN)),
    );
    let scale = ((x.end - x.start) / inside.0).max((y.end - y.start) / inside.1);
    for (range, pixels) in [(x, inside.0), (y, inside.1)] {
        let more = (scale * pixels - (range.end - range.start)) / 2.0;
        *range = range.start - more..range.end + more;
    }
}

fn cloud(panel: &Panel, cloud: &Cloud, area: &Area<'_>) -> Result<(), PlotError> {
    let finite = |p: &&(f64, f64, f64)| p.0.is_finite() && p.1.is_finite() && p.2.is_finite();
    let points = || cloud.points.iter().filter(finite);
    let mut x = range(points().map(|p| p.0), false)?;
    let mut y = range(points().map(|p| p.1), false)?;
    alike((&mut x, &mut y), area);
    let top = if cloud.top > 0.0 { cloud.top } else { 1.0 };
    let spans = (x.end - x.start, y.end - y.start);
    let mut chart = axes(panel, area, (x, y), SCALE)?;
    mesh(&mut chart, panel, spans, None)?;
    let colour = |value: f64| {
        let (r, g, b) = viridis((value / top).min(1.0));
        RGBColor(r, g, b)
    };
    // both ends of the colours are hard to see on one of the papers: each point has a rim, and where they are many a
    // faint one
    let (radius, share) = match cloud.points.len() > MANY {
        true => (DOT, 0.35),
        false => (DOT + 2, 1.0),
    };
    let rim = GREY.mix(share).stroke_width(1);
    for point in points() {
        let at = (point.0, point.1);
        let disc = Circle::new(at, radius, colour(point.2).filled());
        chart.draw_series([disc]).map_err(failed)?;
        let rim = Circle::new(at, radius, rim);
        chart.draw_series([rim]).map_err(failed)?;
    }
    colour_scale(&cloud.unit, area, top, colour)
}

fn map(panel: &Panel, map: &Map, area: &Area<'_>) -> Result<(), PlotError> {
    let (half_x, half_y) = (half(&map.x), half(&map.y));
    let extent = |centres: &[f64], half: f64| -> Result<Range<f64>, PlotError> {
        match centres {
            [first, .., last] => Ok(first - half..last + half),
            [one] => Ok(one - half..one + half),
            [] => Err(failed("a map has no points")),
        }
    };
    let (mut x, mut y) = (extent(&map.x, half_x)?, extent(&map.y, half_y)?);
    alike((&mut x, &mut y), area);
    let shown = map.values.iter().copied().flatten();
    let most = shown.clone().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return Err(failed("a map has no number to show"));
    }
    let top = map.top.filter(|top| *top > 0.0).unwrap_or(most);
    let top = if top > 0.0 { top } else { 1.0 };
    let spans = (x.end - x.start, y.end - y.start);
    let mut chart = axes(panel, area, (x, y), SCALE)?;
    mesh(&mut chart, panel, spans, None)?;
    let colour = |value: f64| {
        let (r, g, b) = viridis(value / top);
        RGBColor(r, g, b)
    };
    let cells = map.values.iter().enumerate().filter_map(|(index, value)| {
        let (column, row) = (index % map.x.len(), index / map.x.len());
        let (x, y) = (map.x[column], map.y[row]);
        let corners = [(x - half_x, y - half_y), (x + half_x, y + half_y)];
        value.map(|value| Rectangle::new(corners, colour(value).filled()))
    });
    chart.draw_series(cells).map_err(failed)?;
    colour_scale(&map.unit, area, top, colour)
}

/// Viridis at a share from 0 to 1.
pub(super) fn viridis(share: f64) -> (u8, u8, u8) {
    let RGBColor(r, g, b) = ViridisRGB::get_color_normalized(share, 0.0, 1.0);
    (r, g, b)
}

/// The bar that says which colour is which value.
fn colour_scale(
    unit: &str,
    area: &Area<'_>,
    top: f64,
    colour: impl Fn(f64) -> RGBColor,
) -> Result<(), PlotError> {
    const STEPS: i32 = 100;
    let (width, height) = area.dim_in_pixel();
    let left = width.saturating_sub(SCALE - 4) as i32;
    let (high, low) = (
        (ABOVE + MARGIN) as i32 + 8,
        height.saturating_sub(BELOW + MARGIN) as i32,
    );
    let at = |share: f64| low - (share * f64::from(low - high)).round() as i32;
    // each step reaches to the top and the next is drawn over it: no seams where a viewer scales the picture
    for step in 0..STEPS {
        let from = f64::from(step) / f64::from(STEPS);
        let corners = [(left, at(1.0)), (left + 14, at(from))];
        area.draw(&Rectangle::new(corners, colour(top * from).filled()))
            .map_err(failed)?;
    }
    let style = TextStyle::from(("sans-serif", LABEL).into_font());
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let text = mark(&(top * share), top / 10.0);
        area.draw_text(&text, &style, (left + 19, at(share) - 6))
            .map_err(failed)?;
    }
    area.draw_text(unit, &style, (left, high - 20))
        .map_err(failed)
}
