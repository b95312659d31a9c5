//! Pictures: what is drawn is there, and in the right place.

use misfit_report::plot::{Content, Figure, Map, Panel, Series, png, svg};

fn panel(title: &str, content: Content) -> Panel {
    Panel {
        title: title.to_owned(),
        x: "time, s".to_owned(),
        y: "force, N".to_owned(),
        content,
    }
}

fn figure() -> Figure {
    let line = |phase: f64| -> Vec<(f64, f64)> {
        (0..200)
            .map(|k| f64::from(k) * 0.05)
            .map(|t| (t, (t + phase).sin()))
            .collect()
    };
    let series = |name: &str, phase: f64, colour, dashed| Series {
        name: name.to_owned(),
        points: line(phase),
        colour,
        dashed,
    };
    let mut broken = series("with a gap", 2.0, 2, false);
    broken.points[90].1 = f64::NAN;
    let x: Vec<f64> = (0..30).map(f64::from).collect();
    let y: Vec<f64> = (0..20).map(f64::from).collect();
    let values = y.iter().flat_map(|y| {
        x.iter()
            .map(move |x| (x + y > 6.0).then_some(x * y / 600.0))
    });
    let map = Map {
        values: values.collect(),
        x: x.clone(),
        y: y.clone(),
        unit: "mm".to_owned(),
        top: None,
    };
    Figure {
        title: vec!["A title & one more".to_owned(), "a line < below".to_owned()],
        panels: vec![
            panel(
                "curves",
                Content::Curves(vec![
                    series("first", 0.0, 0, false),
                    series("second", 1.0, 1, true),
                    broken,
                ]),
            ),
            panel("map", Content::Map(map)),
            panel(
                "bars",
                Content::Bars {
                    labels: vec!["1".to_owned(), "2".to_owned(), "3".to_owned()],
                    series: vec![
                        ("before".to_owned(), vec![3.0, 4.0, 5.0]),
                        ("after".to_owned(), vec![0.3, 0.4, 0.5]),
                    ],
                },
            ),
        ],
        columns: 2,
        panel_size: (460, 320),
    }
}

/// Pixels of a colour, or nearly.
fn pixels(picture: &resvg::tiny_skia::Pixmap, (r, g, b): (u8, u8, u8)) -> usize {
    let near = |a: u8, b: u8| a.abs_diff(b) < 3;
    let all = picture.pixels().iter();
    all.filter(|p| near(p.red(), r) && near(p.green(), g) && near(p.blue(), b))
        .count()
}

#[test]
fn what_is_to_be_shown_is_in_the_picture() {
    let text = svg(&figure()).unwrap();
    for words in [
        "A title &amp; one more",
        "a line &lt; below",
        "first",
        "second",
        "with a gap",
        "before",
        "after",
        "time, s",
        "force, N",
        "mm",
    ] {
        assert!(text.contains(words), "{words} is missing");
    }
    let picture = resvg::tiny_skia::Pixmap::decode_png(&png(&figure()).unwrap()).unwrap();
    assert_eq!(picture.width(), 2 * 2 * 460);
    // lines of 2 px over a few hundred, in three colours; the highest bar is a tenth of a panel
    assert!(pixels(&picture, (0, 158, 115)) > 1000, "third line");
    assert!(pixels(&picture, (213, 94, 0)) > 1000, "dashed line");
    let bars = pixels(&picture, (0, 114, 178));
    assert!(bars > 40_000, "bars: {bars}");
    // both ends of viridis: the highest cell of the map, and the lowest ones
    assert!(pixels(&picture, (68, 1, 84)) > 1000, "lowest cells");
    assert!(pixels(&picture, (254, 231, 37)) > 100, "highest cells");
}

#[test]
fn a_picture_of_nothing_is_refused() {
    let of = |content| Figure {
        panels: vec![panel("", content)],
        ..figure()
    };
    let nothing = Series {
        name: String::new(),
        points: vec![(f64::NAN, 1.0), (0.0, f64::INFINITY)],
        colour: 0,
        dashed: false,
    };
    for content in [
        Content::Curves(vec![]),
        Content::Curves(vec![nothing]),
        Content::Map(Map {
            x: vec![0.0],
            y: vec![0.0],
            values: vec![None],
            unit: String::new(),
            top: None,
        }),
    ] {
        let error = png(&of(content)).unwrap_err().to_string();
        assert!(error.contains("number to show"), "{error}");
    }
}

#[test]
fn the_same_figure_gives_the_same_bytes() {
    assert_eq!(svg(&figure()).unwrap(), svg(&figure()).unwrap());
    assert_eq!(png(&figure()).unwrap(), png(&figure()).unwrap());
}
