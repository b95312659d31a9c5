//! Blind sweeps: the same rows however they are divided, resumed or threaded; figures of hand-made rows.

use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::blind::Expected;
use misfit_cell::sweep::case::{Class, draw};
use misfit_cell::sweep::score::Row;
use misfit_cell::sweep::store::{Shard, StoreError, sweep};
use misfit_cell::sweep::summary::{checks, summary};
use std::fs;
use std::path::Path;

const WHOLE: Shard = Shard { index: 0, count: 1 };

/// The rich design with few poses and cases.
fn small(folder: &Path) -> Scenario {
    let robot = fs::canonicalize("../../models/sda5f/sda5f.urdf").unwrap();
    let text = fs::read_to_string("../../scenarios/blind/rich.toml").unwrap();
    let mut table: toml::Table = text.parse().unwrap();
    table.insert("robot".into(), robot.to_str().unwrap().into());
    let own: toml::Table = "
[design]
poses = 14
heldout_poses = 2
[blind]
one = 3
none = 1
two = 1
outside = 1
resolve_poses = 0
"
    .parse()
    .unwrap();
    for (key, value) in own {
        let (Some(toml::Value::Table(all)), toml::Value::Table(new)) = (table.get_mut(&key), value)
        else {
            panic!("{key}");
        };
        all.extend(new);
    }
    let path = folder.join("small.toml");
    fs::write(&path, toml::to_string(&table).unwrap()).unwrap();
    Scenario::load(&path).unwrap()
}

#[test]
fn shards_threads_and_resumption_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = small(folder.path());
    let cases = scenario.blind.as_ref().unwrap().cases();
    assert_eq!(cases, 6);
    let at = |name: &str| folder.path().join(name);
    let run = |threads: usize, name: &str, shard| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        let rows = pool.install(|| sweep(&scenario, cases, shard, Some(&at(name)), |_| {}));
        rows.unwrap()
    };
    let whole = run(1, "whole", WHOLE);
    assert_eq!(whole.len(), cases);
    let bytes = fs::read(at("whole").join("cases.csv")).unwrap();
    // two shards, on other numbers of threads, put together in one folder
    for index in 0..2 {
        let part = run(
            index + 2,
            &format!("shard{index}"),
            Shard { index, count: 2 },
        );
        assert!(part.len() < cases);
        assert!(!at(&format!("shard{index}")).join("cases.csv").exists());
    }
    for entry in fs::read_dir(at("shard1")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, at("shard0").join(path.file_name().unwrap())).unwrap();
    }
    run(2, "shard0", WHOLE);
    assert_eq!(fs::read(at("shard0").join("cases.csv")).unwrap(), bytes);
    // a part lost is made again, the other is kept as it is
    let kept = at("whole").join("part-000000.csv");
    let before = fs::metadata(&kept).unwrap().modified().unwrap();
    fs::remove_file(at("whole").join("part-000001.csv")).unwrap();
    fs::remove_file(at("whole").join("cases.csv")).unwrap();
    assert_eq!(run(2, "whole", WHOLE), whole);
    assert_eq!(fs::read(at("whole").join("cases.csv")).unwrap(), bytes);
    assert_eq!(fs::metadata(&kept).unwrap().modified().unwrap(), before);
    // a damaged part, and the folder of another sweep, are said
    fs::write(&kept, "case\nx\n").unwrap();
    let error = sweep(&scenario, cases, WHOLE, Some(&at("whole")), |_| {}).unwrap_err();
    assert!(
        matches!(&error, StoreError::Part { file, .. } if file.contains("part-000000")),
        "{error}"
    );
    let mut other = scenario.clone();
    other.seed += 1;
    let error = sweep(&other, cases, WHOLE, Some(&at("shard0")), |_| {}).unwrap_err();
    assert!(matches!(error, StoreError::Other { .. }), "{error}");
}

#[test]
fn cases_are_drawn_as_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = small(folder.path());
    let blind = scenario.blind.clone().unwrap();
    for number in 0..blind.cases() {
        let case = draw(&scenario, number).unwrap();
        let hidden = match case.class {
            Class::None => 0,
            Class::Two => 2,
            Class::One | Class::Outside => 1,
        };
        assert_eq!(case.hidden.len(), hidden);
        assert_eq!(case.contrast.is_some(), case.class == Class::Outside);
        let [low, high] = match case.class {
            Class::One => blind.lambda,
            _ => blind.strong_lambda,
        };
        for (lambda, size) in case.lambdas.iter().zip(&case.sizes) {
            // two steps towards the λ wanted leave a few per cent, unless the size is at its limit
            let near = *lambda > 0.8 * low && *lambda < 1.25 * high;
            assert!(
                near || *size > 0.9 * blind.most,
                "{:?}: {lambda} {size}",
                case.hidden
            );
        }
    }
}

fn row(case: usize, class: &str, lambda: f64, outcome: &str) -> Row {
    Row {
        case,
        class: class.into(),
        hidden: "backlash".into(),
        size: "1".into(),
        lambda,
        deviation: None,
        verdict: "named".into(),
        named: "backlash".into(),
        ranking: String::new(),
        contrast: "pose".into(),
        contrast_found: "pose".into(),
        outcome: outcome.into(),
        explained: 1.0,
        predicted: None,
        evidence: String::new(),
        heldout_base: Some(1.2),
        heldout_named: Some(1.02),
        heldout_oracle: Some(1.0),
        rejected: 0,
        resolved: String::new(),
    }
}

#[test]
fn figures_count_what_they_say() {
    let rows = [
        row(0, "one", 5.0, "missed"),
        row(1, "one", 80.0, "right"),
        row(2, "one", 150.0, "wrong"),
        row(3, "one", 400.0, "right"),
        row(4, "none", 0.0, "right"),
        row(5, "none", 0.0, "unknown"),
        row(6, "two", 70.0, "right"),
        row(7, "outside", 200.0, "right"),
        row(8, "outside", 200.0, "wrong"),
    ];
    let figures = summary(&rows);
    assert_eq!(figures.cases, 9);
    assert_eq!(figures.one[4].wrong, 1);
    assert_eq!(figures.outside_contrast, 1);
    assert_eq!(figures.confusion.values().next().unwrap(), &[2]);
    let expected = Expected {
        named_from_100: Some(0.9),
        alarms: Some(0.5),
        wrong: Some(0.25),
        ..Expected::default()
    };
    let found = checks(&figures, &expected);
    let of = |what: &str| {
        found
            .iter()
            .find(|check| check.what.starts_with(what))
            .unwrap()
    };
    assert_eq!(of("named right, λ ≥ 100").found, Some(0.5));
    assert!(!of("named right, λ ≥ 100").passed);
    assert_eq!(of("wrong").found, Some(0.25));
    assert!(of("wrong").passed && of("alarms").passed);
    assert_eq!(of("outside").found, Some(0.5));
    assert!(of("outside").passed, "nothing is asked");
    assert_eq!(of("held-out").found, Some(1.02));
}

#[test]
fn what_makes_no_sweep_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let good = small(folder.path()).blind.unwrap();
    let mut none = good.clone();
    (none.one, none.none, none.two, none.outside) = (0, 0, 0, 0);
    let mut range = good.clone();
    range.lambda = [30.0, 3.0];
    let mut unknown = good.clone();
    unknown.families = Some(vec!["geometry".into()]);
    for (bad, word) in [
        (none, "one + none"),
        (range, "lambda"),
        (unknown, "geometry"),
    ] {
        let message = bad.check().unwrap_err();
        assert!(
            message.contains(word) && message.contains("accepted"),
            "{message}"
        );
    }
    assert_eq!(good.check(), Ok(()));
}
