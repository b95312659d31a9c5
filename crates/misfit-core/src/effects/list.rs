//! A list of effects as it is said in a few words: `backlash,hysteresis`, or `+backlash` for the default and one more.

use super::table::TableError;
use super::{Entry, Role, find, ids};

/// What the effects of a list are added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    /// The default model of a campaign; beside a model file, the model of that file.
    Default,
    /// The frames alone, which every model has.
    Frames,
}

/// Effects of a model.
#[derive(Debug, Clone)]
pub struct EffectList {
    /// What they are added to.
    pub base: Base,
    /// The effects, in the order in which they are said.
    pub effects: Vec<&'static Entry>,
}

impl EffectList {
    /// The default model.
    pub const DEFAULT: Self = Self {
        base: Base::Default,
        effects: Vec::new(),
    };
    /// The frames alone.
    pub const FRAMES: Self = Self {
        base: Base::Frames,
        effects: Vec::new(),
    };

    /// The frames and the effect of one role.
    pub fn only(role: Role) -> Self {
        Self {
            base: Base::Frames,
            effects: vec![role.entry()],
        }
    }

    /// From comma-separated ids; a leading `+` adds them to the default. `origin` is named in errors.
    ///
    /// # Errors
    /// If there is no such effect.
    pub fn parse(origin: &str, text: &str) -> Result<Self, TableError> {
        let base = match text.starts_with('+') {
            true => Base::Default,
            false => Base::Frames,
        };
        let words = text
            .split(',')
            .map(|word| word.trim().trim_start_matches('+').trim());
        let effects = words.filter(|word| !word.is_empty()).map(|word| {
            find(word).ok_or_else(|| TableError::UnknownEffect {
                file: origin.to_owned(),
                found: word.to_owned(),
                known: ids(),
            })
        });
        Ok(Self {
            base,
            effects: effects.collect::<Result<_, _>>()?,
        })
    }

    /// Is it the default model and nothing more?
    pub fn is_default(&self) -> bool {
        self.base == Base::Default && self.effects.is_empty()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test fails there
mod tests {
    use super::*;

    #[test]
    fn words_become_lists() {
        let cases = [
            ("", Base::Frames, &[][..]),
            ("+", Base::Default, &[][..]),
            ("backlash", Base::Frames, &["backlash"][..]),
            ("+backlash", Base::Default, &["backlash"]),
            (
                "+ hysteresis , +backlash,",
                Base::Default,
                &["hysteresis", "backlash"],
            ),
            ("backlash,backlash", Base::Frames, &["backlash", "backlash"]),
        ];
        for (text, base, effects) in cases {
            let list = EffectList::parse("--effects", text).unwrap();
            let found: Vec<&str> = list.effects.iter().map(|entry| entry.id).collect();
            assert_eq!((list.base, &found[..]), (base, effects), "{text}");
            assert_eq!(list.is_default(), text == "+", "{text}");
        }
        let refused = EffectList::parse("--effects", "backlash,slack").unwrap_err();
        let message = refused.to_string();
        assert!(message.starts_with("--effects: no effect is called \"slack\"; known: "));
    }
}
