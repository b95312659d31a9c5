//! Laws of another form than the catalogue's: what the sweep draws, and what the diagnosis makes of them.

use crate::diagnosis::{campaign_of, found, truth};
use misfit_cell::scenario::Scenario;
use misfit_cell::sweep::case::draw;
use misfit_core::diagnosis::Verdict;
use misfit_core::effects::{CATALOGUE, find};
use std::fs;
use std::path::Path;

/// The committed sweep of other forms with few poses, all cases of this λ.
fn drawn(folder: &Path, wrong_form: bool, lambda: f64) -> Scenario {
    let robot = fs::canonicalize("../../models/sda5f/sda5f.urdf").unwrap();
    let mut rich: toml::Table = fs::read_to_string("../../scenarios/blind/rich.toml")
        .unwrap()
        .parse()
        .unwrap();
    rich.insert("robot".into(), robot.to_str().unwrap().into());
    fs::write(folder.join("rich.toml"), toml::to_string(&rich).unwrap()).unwrap();
    let mut form: toml::Table = fs::read_to_string("../../scenarios/blind/form.toml")
        .unwrap()
        .parse()
        .unwrap();
    let design: toml::Table = "poses = 16\nheldout_poses = 2".parse().unwrap();
    form.insert("design".into(), design.into());
    let toml::Value::Table(blind) = &mut form["blind"] else {
        panic!("no [blind]")
    };
    blind.insert("wrong_form".into(), wrong_form.into());
    blind.insert("lambda".into(), vec![lambda, lambda].into());
    let path = folder.join("form.toml");
    fs::write(&path, toml::to_string(&form).unwrap()).unwrap();
    Scenario::load(&path).unwrap()
}

#[test]
fn a_law_of_another_form_is_still_mostly_the_catalogues() {
    let folder = tempfile::tempdir().unwrap();
    let other = drawn(folder.path(), true, 400.0);
    let families = other.blind.as_ref().unwrap().families();
    assert_eq!(families.len(), 4);
    for number in 0..8 {
        let case = draw(&other, number).unwrap();
        let share = case.deviation.unwrap() / case.lambdas[0];
        // some of the signal is beyond the law, and less than half: else it were another effect's
        assert!(
            share > 1e-4 && share < 0.5,
            "{:?} {number}: {share}",
            case.hidden
        );
    }
    let usual = drawn(folder.path(), false, 400.0);
    assert_eq!(draw(&usual, 0).unwrap().deviation, None);
}

#[test]
fn every_form_is_an_effect_of_its_own_options() {
    let mut some = false;
    for entry in CATALOGUE {
        let forms = entry.all_forms();
        let usual = usize::from(entry.make(toml::Table::new()).is_ok());
        assert_eq!(forms.len(), usual + entry.forms.len(), "{}", entry.id);
        for (form, text) in forms.iter().skip(1).zip(entry.forms) {
            some = true;
            assert_eq!(form.id(), entry.id);
            assert_eq!(*form.options(), text.parse::<toml::Table>().unwrap());
        }
    }
    assert!(some, "no effect has other forms");
}

#[test]
fn a_knee_elsewhere_is_found_with_its_place() {
    let hidden = "[[truth]]\nkind = \"joint_hardening\"\nknee_factor = 0.56\n\
                  values = { r1_l = 4e-5, r1_e = 4e-5 }\n";
    let found = found(&campaign_of(24, hidden, 4));
    assert_eq!(found.verdict, Verdict::Named, "{:?}", found.effects);
    assert_eq!(found.effects, ["joint_hardening"]);
    let term = found.fit.model.term("joint_hardening").unwrap();
    assert_eq!(term.effect.options()["knee_factor"].as_float(), Some(0.56));
    // listed once, whatever its forms
    let rows = found.candidates.iter();
    assert_eq!(rows.filter(|c| c.effect == "joint_hardening").count(), 1);
}

#[test]
fn a_third_harmonic_is_a_form_and_no_second_effect() {
    let third = "[[truth]]\nkind = \"expression\"\nname = \"third\"\nacts_on = \"q[r1_e]\"\n\
                 law = \"a*sin(3*q[r1_e])\"\n\
                 parameters = { a = { unit = \"rad\", typical = 1e-4 } }\nvalues = { a = 8e-5 }\n";
    let hidden = truth("transmission_error", "\"r1_e.sin2\" = 5e-4") + third;
    let found = found(&campaign_of(24, &hidden, 5));
    assert_eq!(found.verdict, Verdict::NamedIncomplete);
    assert_eq!(found.effects, ["transmission_error"]);
    assert_eq!(found.named, ["transmission_error"]);
    assert_eq!(found.steps.len(), 1);
}

#[test]
fn two_effects_of_one_joint_are_two() {
    let both = truth("transmission_error", "\"r1_e.sin2\" = 5e-4")
        + &truth("joint_hardening", "r1_e = 6e-5");
    let found = found(&campaign_of(24, &both, 5));
    let mut effects = found.effects.clone();
    effects.sort();
    assert_eq!(effects, ["joint_hardening", "transmission_error"]);
    assert_eq!(found.verdict, Verdict::Named);
}

#[test]
fn a_factor_that_is_none_is_refused() {
    let entry = find("joint_hardening").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let setup = drawn(folder.path(), true, 100.0).setup;
    for (factor, good) in [(0.5, true), (0.0, false), (-1.0, false), (f64::NAN, false)] {
        let mut options = toml::Table::new();
        options.insert("knee_factor".into(), factor.into());
        let made = entry.make(options).unwrap();
        assert_eq!(made.check(&setup).is_ok(), good, "{factor}");
    }
}
