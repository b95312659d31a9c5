//! Sizes that fall by orders of magnitude: a row each, on a logarithmic axis.

use super::style::{ABOVE, Area, BELOW, COLOURS, GREY, LABEL, MARGIN, failed};
use super::{Levels, Panel, PlotError};
use plotters::element::{Circle, PathElement};
use plotters::style::colors::BLACK;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, IntoFont, ShapeStyle, TextStyle};

/// Width of a letter, about, px: no font is asked.
const LETTER: f64 = 7.2;
/// Room for the legend above the rows, px.
const LEGEND: i32 = 26;
/// Radius of a mark, px.
const MARK: i32 = 5;

/// Where sizes and rows are, px.
struct Frame<'a, 'b> {
    area: &'a Area<'b>,
    left: i32,
    right: i32,
    /// Top of the rows.
    high: i32,
    low: i32,
    /// Ends of the axis: powers of ten.
    powers: (f64, f64),
    rows: usize,
}

pub(super) fn draw(panel: &Panel, levels: &Levels, area: &Area<'_>) -> Result<(), PlotError> {
    let frame = Frame::new(panel, levels, area)?;
    let title = TextStyle::from(("sans-serif", LABEL + 2).into_font());
    let middle = title.pos(Pos::new(HPos::Center, VPos::Top));
    let width = area.dim_in_pixel().0 as i32;
    frame.say(&panel.title, &middle, (width / 2, MARGIN as i32))?;
    frame.grid(panel, levels)?;
    frame.series(levels)?;
    frame.legend(levels)
}

fn at(h: HPos, v: VPos) -> TextStyle<'static> {
    let font = ("sans-serif", LABEL).into_font();
    TextStyle::from(font).pos(Pos::new(h, v))
}

impl<'a, 'b> Frame<'a, 'b> {
    fn new(panel: &Panel, levels: &Levels, area: &'a Area<'b>) -> Result<Self, PlotError> {
        let sizes = levels.series.iter().flat_map(|(_, sizes)| sizes).flatten();
        let (least, most) = sizes
            .chain(levels.reference.iter().map(|(_, size)| size))
            .filter(|size| size.is_finite() && **size > 0.0)
            .fold((f64::INFINITY, 0f64), |(a, b), &x| (a.min(x), b.max(x)));
        if least.is_nan() || most.is_nan() || least > most {
            return Err(failed("a panel has no number to show"));
        }
        let (width, height) = area.dim_in_pixel();
        let longest = levels.rows.iter().map(|row| row.chars().count()).max();
        let left = MARGIN as i32 + 8 + (LETTER * longest.unwrap_or(0) as f64) as i32;
        let right = width as i32 - 2 * MARGIN as i32;
        // without a title its room is left out
        let above = if panel.title.is_empty() { 0 } else { ABOVE };
        Ok(Self {
            area,
            left: left.min(right / 2),
            right,
            high: (above + MARGIN) as i32 + LEGEND,
            low: height as i32 - (BELOW + MARGIN) as i32,
            // an eighth of a decade beside the outermost
            powers: (least.log10() - 0.125, most.log10() + 0.125),
            rows: levels.rows.len().max(1),
        })
    }

    fn x(&self, size: f64) -> i32 {
        let (from, to) = self.powers;
        let share = (size.log10() - from) / (to - from);
        self.left + (share * f64::from(self.right - self.left)).round() as i32
    }

    fn y(&self, row: usize) -> i32 {
        let step = f64::from(self.low - self.high) / self.rows as f64;
        self.high + (step * (row as f64 + 0.5)).round() as i32
    }

    fn say(&self, text: &str, style: &TextStyle<'_>, place: (i32, i32)) -> Result<(), PlotError> {
        self.area.draw_text(text, style, place).map_err(failed)
    }

    fn line(&self, from: (i32, i32), to: (i32, i32), style: ShapeStyle) -> Result<(), PlotError> {
        let path = PathElement::new(vec![from, to], style);
        self.area.draw(&path).map_err(failed)
    }

    /// Axis, rows and the reference.
    fn grid(&self, panel: &Panel, levels: &Levels) -> Result<(), PlotError> {
        let &Self {
            left,
            right,
            high,
            low,
            powers: (from, to),
            ..
        } = self;
        let grid = BLACK.mix(0.12).stroke_width(1);
        for (size, text) in ticks(from, to) {
            let x = self.x(size);
            self.line((x, high), (x, low), grid)?;
            self.say(&text, &at(HPos::Center, VPos::Top), (x, low + 5))?;
        }
        self.line((left, low), (right, low), GREY.stroke_width(1))?;
        let below = ((left + right) / 2, low + 23);
        self.say(&panel.x, &at(HPos::Center, VPos::Top), below)?;
        for (row, name) in levels.rows.iter().enumerate() {
            let (y, style) = (self.y(row), BLACK.mix(0.06).stroke_width(1));
            self.say(name, &at(HPos::Right, VPos::Center), (left - 8, y))?;
            self.line((left, y), (right, y), style)?;
        }
        if let Some((_, size)) = levels.reference.as_ref().filter(|(_, size)| *size > 0.0) {
            let (x, style) = (self.x(*size), COLOURS[2].stroke_width(2));
            for part in (high..low).step_by(8) {
                self.line((x, part), (x, (part + 5).min(low)), style)?;
            }
        }
        Ok(())
    }

    fn series(&self, levels: &Levels) -> Result<(), PlotError> {
        for (index, (_, sizes)) in levels.series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let found = sizes.iter().enumerate();
            let found = found.filter_map(|(row, size)| Some((row, (*size)?)));
            let places: Vec<(i32, i32)> = found
                .filter(|(_, size)| size.is_finite() && *size > 0.0)
                .map(|(row, size)| (self.x(size), self.y(row)))
                .collect();
            let path = PathElement::new(places.clone(), colour.mix(0.4).stroke_width(1));
            self.area.draw(&path).map_err(failed)?;
            for place in places {
                mark(self.area, place, index)?;
            }
        }
        Ok(())
    }

    fn legend(&self, levels: &Levels) -> Result<(), PlotError> {
        let mut next = self.left;
        let row = self.high - LEGEND + 6;
        let style = at(HPos::Left, VPos::Center);
        for (index, (name, _)) in levels.series.iter().enumerate() {
            mark(self.area, (next + MARK, row), index)?;
            self.say(name, &style, (next + 3 * MARK, row))?;
            next += 5 * MARK + (LETTER * name.chars().count() as f64) as i32;
        }
        if let Some((name, _)) = &levels.reference {
            let style_of_line = COLOURS[2].stroke_width(2);
            self.line((next, row), (next + 7, row), style_of_line)?;
            self.line((next + 11, row), (next + 18, row), style_of_line)?;
            self.say(name, &style, (next + 24, row))?;
        }
        Ok(())
    }
}

/// Told apart by shape too: the first a disc, the others rings.
fn mark(area: &Area<'_>, place: (i32, i32), index: usize) -> Result<(), PlotError> {
    let colour = COLOURS[index % COLOURS.len()];
    let style = match index {
        0 => colour.filled(),
        _ => colour.stroke_width(2),
    };
    area.draw(&Circle::new(place, MARK, style)).map_err(failed)
}

/// Round numbers from `10^from` to `10^to`: 1, 2 and 5 of each decade, 1 alone where there are many.
fn ticks(from: f64, to: f64) -> Vec<(f64, String)> {
    let steps: &[f64] = match to - from {
        span if span > 3.2 => &[1.0],
        span if span > 2.0 => &[1.0, 3.0],
        _ => &[1.0, 2.0, 5.0],
    };
    let mut found = Vec::new();
    for decade in from.floor() as i32..=to.floor() as i32 {
        for step in steps {
            let size = step * 10f64.powi(decade);
            if (from..=to).contains(&size.log10()) {
                let decimals = (-decade).max(0) as usize;
                found.push((size, format!("{size:.decimals$}")));
            }
        }
    }
    found
}
