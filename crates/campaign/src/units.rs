//! Units a table column may be written in, and their way to SI units and radians.

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dimension {
    Angle,
    Length,
    Mass,
    Force,
    Torque,
    Time,
    /// °C is the inner unit, as the types of a campaign say.
    Temperature,
}

/// One unit as it ends a header word.
#[derive(Debug)]
pub(super) struct Unit {
    pub(super) name: &'static str,
    pub(super) dimension: Dimension,
    /// Divides rather than multiplies by 0.001: the quotient is the nearest number to the decimal one.
    pub(super) to_inner: fn(f64) -> f64,
}

const fn unit(name: &'static str, dimension: Dimension, to_inner: fn(f64) -> f64) -> Unit {
    Unit {
        name,
        dimension,
        to_inner,
    }
}

/// Every known unit; the first of each dimension is the one used inside and written out.
pub(super) const UNITS: [Unit; 17] = [
    unit("rad", Dimension::Angle, |x| x),
    unit("mrad", Dimension::Angle, |x| x / 1e3),
    unit("urad", Dimension::Angle, |x| x / 1e6),
    unit("deg", Dimension::Angle, f64::to_radians),
    unit("m", Dimension::Length, |x| x),
    unit("mm", Dimension::Length, |x| x / 1e3),
    unit("um", Dimension::Length, |x| x / 1e6),
    unit("kg", Dimension::Mass, |x| x),
    unit("g", Dimension::Mass, |x| x / 1e3),
    unit("N", Dimension::Force, |x| x),
    unit("kN", Dimension::Force, |x| x * 1e3),
    unit("Nm", Dimension::Torque, |x| x),
    unit("s", Dimension::Time, |x| x),
    unit("ms", Dimension::Time, |x| x / 1e3),
    unit("min", Dimension::Time, |x| x * 60.0),
    unit("degC", Dimension::Temperature, |x| x),
    unit("K", Dimension::Temperature, |x| x - 273.15),
];

/// The way from a unit of a joint's position, by name, to m where it slides and rad where it turns.
pub fn to_inner(name: &str, slides: bool) -> Option<fn(f64) -> f64> {
    let dimension = if slides {
        Dimension::Length
    } else {
        Dimension::Angle
    };
    let mut units = UNITS.iter();
    let unit = units.find(|unit| unit.name == name && unit.dimension == dimension)?;
    Some(unit.to_inner)
}

/// Names of the units of one dimension, or of all.
pub(super) fn names(dimension: Option<Dimension>) -> String {
    let names: Vec<&str> = UNITS
        .iter()
        .filter(|u| dimension.is_none_or(|d| d == u.dimension))
        .map(|u| u.name)
        .collect();
    names.join(", ")
}

/// Units that people write and that no header word of the plain format ends with.
const MORE: [Unit; 5] = [
    unit("cm", Dimension::Length, |x| x / 1e2),
    unit("in", Dimension::Length, |x| x * 0.0254),
    unit("h", Dimension::Time, |x| x * 3600.0),
    unit("d", Dimension::Time, |x| x * 86400.0),
    unit("lb", Dimension::Mass, |x| x * 0.453_592_37),
];

/// Other words for units.
const SPOKEN: [(&str, &str); 24] = [
    ("°", "deg"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("grad", "deg"), // German for degrees; gons are no unit of robots
    ("radian", "rad"),
    ("radians", "rad"),
    ("µrad", "urad"),
    ("μrad", "urad"),
    ("metre", "m"),
    ("meter", "m"),
    ("millimetre", "mm"),
    ("millimeter", "mm"),
    ("µm", "um"),
    ("μm", "um"),
    ("inch", "in"),
    ("\"", "in"),
    ("sec", "s"),
    ("seconds", "s"),
    ("°c", "degC"),
    ("c", "degC"),
    ("celsius", "degC"),
    ("n·m", "Nm"),
    ("n*m", "Nm"),
    ("kgs", "kg"),
];

/// The unit of a word as people write it: any case, in brackets or not.
pub(super) fn spoken(word: &str, dimension: Dimension) -> Option<&'static Unit> {
    static EXTRA: [Unit; 5] = MORE;
    static KNOWN: [Unit; 17] = UNITS;
    let word = word.trim().trim_matches(['[', ']', '(', ')']).trim();
    let all = || {
        let units = KNOWN.iter().chain(&EXTRA);
        units.filter(|unit| unit.dimension == dimension)
    };
    // by case first: mm is no Mm, and nobody means that
    if let Some(unit) = all().find(|unit| unit.name == word) {
        return Some(unit);
    }
    let lower = word.to_lowercase();
    let name = SPOKEN
        .iter()
        .find(|(spoken, _)| *spoken == lower)
        .map_or(lower.as_str(), |(_, name)| name);
    all().find(|unit| unit.name.eq_ignore_ascii_case(name))
}
