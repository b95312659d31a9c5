//! Campaign files: what is read, what is refused and how, and that nothing is lost in writing.

#![allow(clippy::unwrap_used)]

use crate::measured::measured;
use crate::two_arms::{DH_TABLE, TWO_ARMS, assert_same};
use misfit_arm::robot::Robot;
use misfit_campaign::{
    Campaign, Frame, LoadError, Noise, Payload, Reading, RobotFile, Split, Target, Wrench,
};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const ONE_TARGET: &str = "robot = \"arm.urdf\"\ntable = \"t.csv\"\n\
    [[target]]\nname = \"left\"\nlink = \"left_flange\"\n";
const TWO_TARGETS: &str = "robot = \"arm.urdf\"\ntable = \"t.csv\"\n\
    [[target]]\nname = \"left\"\nlink = \"left_flange\"\n\
    [[target]]\nname = \"right\"\nlink = \"right_flange\"\n";
const HEADER: &str = "torso_rad,slide_m,wrist_deg,x_m,y_m,z_mm";

/// Writes the three files of a campaign and reads them.
fn load(document: &str, table: impl AsRef<[u8]>) -> Result<Campaign, LoadError> {
    let folder = TempDir::new().unwrap();
    load_in(folder.path(), document, table)
}

fn load_in(folder: &Path, document: &str, table: impl AsRef<[u8]>) -> Result<Campaign, LoadError> {
    fs::write(folder.join("arm.urdf"), TWO_ARMS).unwrap();
    fs::write(folder.join("c.toml"), document).unwrap();
    fs::write(folder.join("t.csv"), table).unwrap();
    Campaign::load(&folder.join("c.toml"))
}

/// The message of a refused campaign, which has to hold all `parts`.
#[track_caller]
fn refused(document: &str, table: impl AsRef<[u8]>, parts: &[&str]) {
    let message = load(document, table)
        .expect_err("should be refused")
        .to_string();
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

#[track_caller]
fn refused_table(table: &str, parts: &[&str]) {
    refused(ONE_TARGET, table, &[&["t.csv"], parts].concat());
}

#[track_caller]
fn refused_document(more: &str, parts: &[&str]) {
    let table = format!("{HEADER}\n0,0,0,1,2,3\n");
    refused(
        &format!("{ONE_TARGET}{more}"),
        table,
        &[&["c.toml"], parts].concat(),
    );
}

/// Warnings name the table without its folder, so that recordings do not depend on it.
fn warning(campaign: &Campaign, part: &str) -> bool {
    campaign
        .warnings
        .iter()
        .any(|w| w.starts_with("t.csv: ") && w.contains(part))
}

#[test]
fn a_one_row_table_of_plain_numbers() {
    let campaign = load(ONE_TARGET, format!("{HEADER}\n0.5,0.25,90,1,2,3\n")).unwrap();
    assert_eq!(campaign.name, "c.toml");
    assert_eq!(campaign.robot_file.name, "arm.urdf");
    assert_eq!(campaign.robot_file.text, TWO_ARMS);
    assert_eq!(campaign.gravity, Vector3::new(0.0, 0.0, -9.81));
    assert_eq!(campaign.base_from_tracker, Frame::Estimate);
    assert_eq!(campaign.link_from_target, [Frame::Estimate]);
    assert_eq!(campaign.noise, None);
    assert!(campaign.warnings.is_empty(), "{:?}", campaign.warnings);
    let joint = |name| campaign.robot.joint(name).unwrap();
    let [reading] = &campaign.readings[..] else {
        panic!("one reading")
    };
    assert_eq!(reading.line, 2);
    assert_eq!(reading.joints[joint("torso")], 0.5);
    assert_eq!(reading.joints[joint("slide")], 0.25);
    assert_eq!(reading.joints[joint("wrist")], std::f64::consts::FRAC_PI_2);
    assert_eq!(reading.position, Vector3::new(1.0, 2.0, 0.003));
    assert_eq!(reading.pose, None);
    assert_eq!(reading.time, None);
    assert_eq!(reading.split, Split::Fit);
    assert_eq!((reading.wrench, reading.payload), (None, None));
}

#[test]
fn every_column_and_every_key() {
    let document = format!(
        "{}gravity = [0, 1, -9]\n{}\
         [frames]\nbase_from_tracker = [1, 2, 3, 1, 0, 0, 0]\n\
         link_from_target = {{ left = [0, 0, 0.1, 0, 1, 0, 0] }}\n\
         [noise]\nposition_m = 1e-5\nposition_per_metre = 6e-6\nradial_position_m = 5e-7\n\
         orientation_rad = 1e-4\njoint_rad = 2e-5\nforce_N = 0.05\ntorque_Nm = 0.005\n\
         [split]\ncolumn = \"set\"\n",
        "robot = \"arm.urdf\"\ntable = \"t.csv\"\nbase = \"base\"\n",
        "[[target]]\nname = \"left\"\nlink = \"left_flange\"\n\
         [[target]]\nname = \"right\"\nlink = \"right_flange\"\n",
    );
    let table = "pose,repeat,target,set,time_min,temperature_K,temperature_trunk_degC,\
        torso_mrad,slide_mm,wrist_urad,approach_torso,approach_wrist,x_um,y_m,z_m,qw,qx,qy,qz,\
        fx_kN,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm,payload_g,payload_x_mm,payload_y_m,payload_z_m\n\
        p1,a,right,heldout,2,300.15,25,500,250,100,-1,+1,1000,2,3,1.0005,0,0,0,\
        0.002,3,4,5,6,7,1500,10,0.2,0.3\n";
    let campaign = load(&document, table).unwrap();
    assert_eq!(campaign.robot_file.base.as_deref(), Some("base"));
    assert_eq!(campaign.gravity, Vector3::new(0.0, 1.0, -9.0));
    assert_eq!(
        campaign.base_from_tracker,
        Frame::Known(Isometry3::translation(1.0, 2.0, 3.0))
    );
    assert!(matches!(campaign.link_from_target[0], Frame::Known(_)));
    assert_eq!(campaign.link_from_target[1], Frame::Estimate);
    let noise = campaign.noise.unwrap();
    assert_eq!((noise.position, noise.radial), (1e-5, 5e-7));
    // What the file does not say along the beam is as across it.
    assert_eq!(noise.radial_per_metre, 6e-6);
    assert_eq!(
        (noise.force, noise.torque, noise.joint),
        (0.05, 0.005, 2e-5)
    );
    let reading = &campaign.readings[0];
    assert_eq!(reading.pose.as_deref(), Some("p1"));
    assert_eq!(reading.repeat.as_deref(), Some("a"));
    assert_eq!(reading.target, 1);
    assert_eq!(reading.split, Split::Heldout);
    assert_eq!(reading.time, Some(120.0));
    assert!((reading.temperature.unwrap() - 27.0).abs() < 1e-9);
    let trunk = campaign.robot.link("trunk").unwrap();
    assert_eq!(reading.link_temperatures, [(trunk, 25.0)]);
    let joint = |name| campaign.robot.joint(name).unwrap();
    assert_eq!(reading.joints[joint("torso")], 0.5);
    assert_eq!(reading.joints[joint("slide")], 0.25);
    assert_eq!(reading.joints[joint("wrist")], 1e-4);
    let approach = reading.approach.as_ref().unwrap();
    assert_eq!(approach[joint("torso")], -1.0);
    assert_eq!(approach[joint("slide")], 0.0);
    assert_eq!(approach[joint("wrist")], 1.0);
    assert_eq!(reading.position, Vector3::new(0.001, 2.0, 3.0));
    // A norm within 1e-3 of 1 is rounding of the instrument's export.
    assert_eq!(reading.orientation, Some(UnitQuaternion::identity()));
    let wrench = reading.wrench.unwrap();
    assert_eq!(wrench.force, Vector3::new(2.0, 3.0, 4.0));
    assert_eq!(wrench.torque, Vector3::new(5.0, 6.0, 7.0));
    let payload = reading.payload.unwrap();
    assert_eq!(payload.mass, 1.5);
    assert_eq!(payload.com, Vector3::new(0.01, 0.2, 0.3));
}

#[test]
fn joints_without_a_column_stay_at_zero_with_a_warning() {
    let campaign = load(ONE_TARGET, "torso_rad,x_m,y_m,z_m\n0.5,1,2,3\n").unwrap();
    assert!(
        warning(&campaign, "no column for slide, wrist: taken"),
        "{:?}",
        campaign.warnings
    );
    assert_eq!(campaign.readings[0].joints.iter().sum::<f64>(), 0.5);
}

#[test]
fn a_payload_without_a_centre_hangs_at_the_link() {
    let campaign = load(ONE_TARGET, format!("{HEADER},payload_kg\n0,0,0,1,2,3,4\n")).unwrap();
    let payload = campaign.readings[0].payload.unwrap();
    assert_eq!((payload.mass, payload.com), (4.0, Vector3::zeros()));
}

#[test]
fn a_part_that_a_whole_row_leaves_empty_is_not_given_and_said_so() {
    let table = "target,torso_rad,slide_m,wrist_rad,x_m,y_m,z_m,qw,qx,qy,qz\n\
        left,0,0,0,1,2,3,,,,\n\nright,0,0,0,1,2,3,1,0,0,0\n";
    let campaign = load(TWO_TARGETS, table).unwrap();
    assert_eq!(campaign.readings[0].orientation, None);
    assert!(campaign.readings[1].orientation.is_some());
    assert_eq!(campaign.readings[1].line, 4, "the blank line counts");
    assert!(warning(
        &campaign,
        "1 of 2 readings leave the orientation empty (first in line 2)"
    ));
}

#[test]
fn line_endings_byte_order_mark_quotes_and_blanks_are_no_obstacle() {
    let table = format!("\u{feff}{HEADER},pose\r\n 0 ,0,0,\"1\",2,3, \"a, b\" \r\n\r\n");
    let campaign = load(
        ONE_TARGET,
        table.replace(", \"a", ",\"a").replace("\" \r", "\"\r"),
    );
    assert_eq!(campaign.unwrap().readings[0].pose.as_deref(), Some("a, b"));
}

#[test]
fn headers_that_are_refused() {
    let row = "\n0,0,0,1,2,3\n";
    let with = |header: &str| format!("{header}{row}");
    refused_table(
        &with("torso_grad,slide_m,wrist_deg,x_m,y_m,z_m"),
        &[
            "line 1",
            "`torso_grad`",
            "unknown unit \"grad\"",
            "torso_rad, torso_mrad",
            "torso_deg",
            "known units: rad, mrad",
        ],
    );
    refused_table(
        &with("torso_rad,slide_deg,wrist_deg,x_m,y_m,z_m"),
        &[
            "line 1",
            "`slide_deg`",
            "unit \"deg\"",
            "does not fit",
            "slide_m, slide_mm",
        ],
    );
    refused_table(
        &with("torso,slide_m,wrist_deg,x_m,y_m,z_m"),
        &["line 1", "`torso`", "no unit", "torso_rad"],
    );
    refused_table(
        &with("torsoo_rad,slide_m,wrist_deg,x_m,y_m,z_m"),
        &[
            "line 1",
            "`torsoo_rad`",
            "unknown column",
            "did you mean `torso_rad`",
        ],
    );
    refused_table(
        &with("torso_rad,torso_deg,wrist_deg,x_m,y_m,z_m"),
        &[
            "line 1",
            "`torso_deg`",
            "columns 1 (\"torso_rad\") and 2 (\"torso_deg\")",
            "one column for each",
        ],
    );
    refused_table(
        &with("torso_rad,slide_m,wrist_deg,x_m,x_m,z_m"),
        &["line 1", "`x_m`", "twice"],
    );
    refused_table(
        &with("torso_rad,slide_m,wrist_deg,x_m,y_m,time_s"),
        &["line 1", "`z_m`", "no such column", "x_m y_m z_m"],
    );
    refused_table(
        "x_m,y_m,z_m\n1,2,3\n",
        &["line 1", "`torso_rad`", "no such column", "slide_m"],
    );
    refused_table(
        &format!("{HEADER},qw,qx,qy\n"),
        &["line 1", "`qz`", "no such column", "qw qx qy qz"],
    );
    refused_table(
        &format!("{HEADER},fx_N\n"),
        &["line 1", "`fy_N`", "fx_N fy_N fz_N tx_Nm ty_Nm tz_Nm"],
    );
    refused_table(
        &format!("{HEADER},payload_x_m,payload_y_m,payload_z_m\n"),
        &["line 1", "`payload_kg`", "no such column"],
    );
    refused_table(
        &format!("{HEADER},payload_kg,payload_x_m\n"),
        &["line 1", "`payload_y_m`"],
    );
    refused_table(&format!("{HEADER},\n"), &["line 1", "number 7", "no name"]);
    refused_table(
        "torso_rad;slide_m\n0;0\n",
        &["line 1", "semicolons", "commas"],
    );
    refused_table("\n", &["line 1", "empty file"]);
    refused_table("", &["line 1", "empty file"]);
    refused_table(&format!("\n{HEADER}\n"), &["line 1", "blank line"]);
    refused_table(
        &format!("{HEADER}\n"),
        &["line 1", "without a single reading"],
    );
    refused(
        TWO_TARGETS,
        format!("{HEADER}\n0,0,0,1,2,3\n"),
        &["line 1", "`target`", "no such column", "several targets"],
    );
}

#[test]
fn cells_that_are_refused() {
    let row = |row: &str| format!("{HEADER}\n0,0,0,1,2,3\n\n{row}\n");
    let accepted = "a finite number, with a point for decimals";
    refused_table(
        &row("0,abc,0,1,2,3"),
        &["line 4", "`slide_m`", "\"abc\"", accepted],
    );
    refused_table(
        &row("0,0,0,1,2,NaN"),
        &["line 4", "`z_mm`", "\"NaN\"", accepted],
    );
    refused_table(
        &row("0,0,0,-inf,2,0"),
        &["line 4", "`x_m`", "\"-inf\"", accepted],
    );
    refused_table(
        &row("0,0,0,1e999,2,0"),
        &["line 4", "`x_m`", "\"1e999\"", accepted],
    );
    refused_table(
        &row("0,0,,1,2,3"),
        &["line 4", "`wrist_deg`", "an empty cell", "a number"],
    );
    refused_table(
        &row("0,0,0,1,2"),
        &["line 4", "found 5 cells", "accepted: 6"],
    );
    refused_table(
        &row("0,0,0,1,2,3,4"),
        &["line 4", "found 7 cells", "accepted: 6"],
    );

    let with = |column: &str, cell: &str| format!("{HEADER},{column}\n0,0,0,1,2,3,{cell}\n");
    refused_table(
        &with("target", "right"),
        &[
            "line 2",
            "`target`",
            "\"right\"",
            "accepted: a target of the campaign file: left",
        ],
    );
    refused_table(
        &with("approach_torso", "0.5"),
        &["line 2", "`approach_torso`", "\"0.5\"", "-1, 0 or 1"],
    );
    refused_table(
        &with("approach_torso,approach_slide", "1,"),
        &[
            "line 2",
            "`approach_slide`",
            "empty",
            "approach_torso approach_slide",
        ],
    );
    refused_table(
        &with("payload_kg", "-1"),
        &["line 2", "`payload_kg`", "\"-1\"", "zero or more"],
    );
    refused_table(
        &with("payload_kg,payload_x_m,payload_y_m,payload_z_m", ",0,0,0"),
        &["line 2", "`payload_kg`", "an empty cell"],
    );
    refused_table(
        &with("qw,qx,qy,qz", "1,0,0,0.1"),
        &["line 2", "`qw`", "norm 1.004", "norm 1 within 0.001"],
    );
    refused_table(
        &with("qw,qx,qy,qz", "0,0,0,0"),
        &["line 2", "`qw`", "norm 0", "unit quaternion"],
    );
    refused_table(
        &with("qw,qx,qy,qz", "1,0,,0"),
        &[
            "line 2",
            "`qy`",
            "an empty cell",
            "all of qw qx qy qz empty",
        ],
    );
    refused_table(
        &with("pose", "\"a\nb\""),
        &["line 2", "`pose`", "line breaks"],
    );
    refused(
        &format!("{ONE_TARGET}[split]\ncolumn = \"split\"\n"),
        with("split", "train"),
        &["line 2", "`split`", "\"train\"", "fit or heldout"],
    );
}

#[test]
fn tables_that_are_no_text_or_too_long() {
    let mut table = format!("{HEADER}\n0,0,0,1,2,").into_bytes();
    table.extend(b"\xff\n");
    refused(
        ONE_TARGET,
        table,
        &["t.csv", "line 2", "`z_mm`", "not UTF-8"],
    );
    // UTF-16, as its byte order mark says
    refused(ONE_TARGET, b"\xff\xfet\0o\0", &["t.csv", "line 1", "`to`"]);
    let mut table = format!("{HEADER}\n").into_bytes();
    table.extend(vec![b'1'; 1_100_000]);
    refused(ONE_TARGET, table, &["t.csv", "line 2", "longer than 1 MB"]);

    let folder = TempDir::new().unwrap();
    load_in(folder.path(), ONE_TARGET, "").unwrap_err();
    // A sparse file: nothing is written, and nothing must be read.
    let file = fs::File::create(folder.path().join("t.csv")).unwrap();
    file.set_len(2_000_000_001).unwrap();
    let message = Campaign::load(&folder.path().join("c.toml"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("t.csv") && message.contains("2 GB"),
        "{message}"
    );
}

#[test]
fn campaign_files_that_are_refused() {
    refused_document("tabel = 1\n", &["line 6", "unknown field", "link"]);
    refused_document(
        "[frames]\nbase = 1\n",
        &["unknown field `base`", "base_from_tracker"],
    );
    refused_document(
        "[noise]\nposition_mm = 1\n",
        &["unknown field `position_mm`", "position_m"],
    );
    refused_document("[split]\ncol = \"x\"\n", &["unknown field `col`", "column"]);
    refused_document(
        "[noise]\nposition_m = -1\n",
        &["noise.position_m", "found -1", "zero or more"],
    );
    refused_document(
        "[noise]\ntorque_Nm = inf\n",
        &["noise.torque_Nm", "found inf"],
    );
    for frame in [
        "\"guess\"",
        "[1, 2, 3]",
        "[0, 0, 0, 1, 0, 0, nan]",
        "[inf, 0, 0, 1, 0, 0, 0]",
        "[0, 0, 0, 2, 0, 0, 0]",
        "3",
    ] {
        for key in ["base_from_tracker", "link_from_target"] {
            refused_document(
                &format!("[frames]\n{key} = {frame}\n"),
                &[
                    "frames.",
                    key,
                    "found",
                    "estimate",
                    "[x, y, z, qw, qx, qy, qz]",
                ],
            );
        }
    }
    refused_document(
        "[frames]\nlink_from_target = { rigth = \"estimate\" }\n",
        &[
            "frames.link_from_target",
            "\"rigth\"",
            "names of targets: left",
        ],
    );
    refused_document(
        "[[target]]\nname = \"left\"\nlink = \"base\"\n",
        &["target.name", "\"left\"", "name of its own"],
    );
    refused_document(
        "[[target]]\nname = \"tool\"\nlink = \"tool0\"\n",
        &[
            "target.link",
            "\"tool0\"",
            "a link of the robot: base, trunk",
        ],
    );
    refused_document("[split]\n", &["split", "column", "fraction"]);
    refused_document("[split]\nfraction = 0.5\n", &["split", "seed"]);
    refused_document(
        "[split]\nfraction = 1.0\nseed = 1\n",
        &["split.fraction", "found 1", "below 1"],
    );
    let table = format!("{HEADER}\n0,0,0,1,2,3\n");
    let with_split = |name: &str| format!("{ONE_TARGET}[split]\ncolumn = \"{name}\"\n");
    refused(
        &with_split("set"),
        &table,
        &["t.csv", "line 1", "`set`", "no such column"],
    );
    refused(
        &with_split("x_m"),
        &table,
        &["t.csv", "line 1", "`x_m`", "meaning of its own"],
    );
    let top = |text: &str| format!("{text}\n{ONE_TARGET}");
    refused(
        &top("gravity = [0, 0, nan]"),
        &table,
        &["c.toml", "gravity", "finite"],
    );
    refused(&top("gravity = [0, 0]"), &table, &["c.toml", "line 1"]);
    refused(
        "robot = \"arm.urdf\"\ntable = \"t.csv\"\n",
        &table,
        &["c.toml", "`target`", "at least one"],
    );
    refused(
        "robot = \"arm.urdf\"\n[[target]]\nname = \"l\"\nlink = \"base\"\n",
        &table,
        &["c.toml", "`table`", "CSV"],
    );
    refused("robot = ", &table, &["c.toml", "line 1"]);
    refused(
        &ONE_TARGET.replace("arm.urdf", "gone.urdf"),
        &table,
        &["gone.urdf", "cannot be read"],
    );
    refused(
        &ONE_TARGET.replace("t.csv", "gone.csv"),
        &table,
        &["gone.csv", "cannot be read"],
    );
    refused(&ONE_TARGET.replace("arm.urdf", "t.csv"), &table, &["t.csv"]);
}

#[test]
fn files_of_another_kind_are_refused() {
    for (name, found) in [("readings.csv", ".csv"), ("campaign", "without an ending")] {
        let message = Campaign::load(Path::new(name)).unwrap_err().to_string();
        assert!(
            message.contains(name) && message.contains(found) && message.contains(".mcap"),
            "{message}"
        );
    }
    let message = Campaign::load(Path::new("no/such.toml"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("no/such.toml: cannot be read"),
        "{message}"
    );
}

#[test]
fn a_column_split_that_is_not_asked_for_is_reported() {
    let campaign = load(ONE_TARGET, format!("{HEADER},split\n0,0,0,1,2,3,heldout\n")).unwrap();
    assert_eq!(campaign.readings[0].split, Split::Fit);
    assert!(warning(&campaign, "`split` is not used"));
}

#[test]
fn whole_poses_are_drawn_the_same_for_the_same_seed() {
    let document = |seed| format!("{TWO_TARGETS}[split]\nfraction = 0.3\nseed = {seed}\n");
    // With labels, and without: 20 poses, each seen at both targets and twice.
    for label in [true, false] {
        let mut table = String::from("target,torso_rad,x_m,y_m,z_m");
        table.push_str(if label { ",pose\n" } else { "\n" });
        for row in 0..80 {
            let (pose, target) = (row / 2 % 20, ["left", "right"][row % 2]);
            let q = if label { row } else { pose };
            table.push_str(&format!("{target},{q},1,2,3"));
            table.push_str(&if label {
                format!(",p{pose}\n")
            } else {
                "\n".into()
            });
        }
        let heldout = |seed| -> Vec<bool> {
            let campaign = load(&document(seed), &table).unwrap();
            campaign
                .readings
                .iter()
                .map(|r| r.split == Split::Heldout)
                .collect()
        };
        let first = heldout(1);
        assert_eq!(first, heldout(1));
        assert_ne!(first, heldout(2));
        assert_eq!(first.iter().filter(|h| **h).count(), 6 * 4);
        for row in 0..80 {
            assert_eq!(first[row], first[row / 2 % 20 * 2], "poses are drawn whole");
        }
    }
}

#[test]
fn the_measured_ur10_is_read_whole() {
    let Some(path) = measured("campaign::the_measured_ur10_is_read_whole", "series_C.toml") else {
        return;
    };
    let campaign = Campaign::load(&path).unwrap();
    assert_eq!(campaign.readings.len(), 2773);
    assert_eq!(campaign.robot.joints.len(), 6);
    assert!(campaign.warnings.is_empty(), "{:?}", campaign.warnings);
    let last = campaign.readings.last().unwrap();
    assert_eq!((last.line, last.pose.as_deref()), (2774, Some("2772")));
    assert!(
        campaign
            .readings
            .iter()
            .all(|r| r.orientation.is_some() && r.temperature.is_some())
    );
    let heldout = campaign
        .readings
        .iter()
        .filter(|r| r.split == Split::Heldout);
    assert!(heldout.count() > 500);
    let folder = TempDir::new().unwrap();
    campaign.write_csv(folder.path()).unwrap();
    let again = Campaign::load(&folder.path().join("campaign.toml")).unwrap();
    assert_eq!(as_table(campaign), again);
}

/// What a written table makes of a campaign: the files' own name and line numbers, no warnings.
fn as_table(mut campaign: Campaign) -> Campaign {
    campaign.name = "campaign.toml".into();
    campaign.warnings.clear();
    for (index, reading) in campaign.readings.iter_mut().enumerate() {
        reading.line = index + 2;
    }
    campaign
}

/// Numbers as they come: small, large, negative zero, all digits.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -10.0..10.0f64,
        -1e-4..1e-4f64,
        Just(-0.0),
        Just(1e300),
        Just(f64::MIN_POSITIVE),
        proptest::num::f64::NORMAL,
    ]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    [number(), number(), number()].prop_map(Vector3::from)
}

fn rotation() -> impl Strategy<Value = UnitQuaternion<f64>> {
    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0, 0.1..1.0]
        .prop_map(|q| UnitQuaternion::new_normalize(Quaternion::from(q)))
}

fn frame() -> impl Strategy<Value = Frame> {
    prop_oneof![
        Just(Frame::Estimate),
        (vector(), rotation())
            .prop_map(|(t, q)| Frame::Known(Isometry3::from_parts(Translation3::from(t), q))),
    ]
}

fn label() -> impl Strategy<Value = String> {
    "[a-zA-Z0-9\"',;#=µ]([ a-z\"',\\\\]{0,6}[a-z0-9\"',;#])?"
}

fn noise() -> impl Strategy<Value = Noise> {
    proptest::array::uniform8(0.0..1e-2f64).prop_map(|n| Noise {
        position: n[0],
        position_per_metre: n[1],
        radial: n[2],
        radial_per_metre: n[3],
        orientation: n[4],
        joint: n[5],
        force: n[6],
        torque: n[7],
    })
}

fn reading(robot: &Robot, targets: usize) -> impl Strategy<Value = Reading> + use<> {
    use proptest::collection::vec;
    use proptest::option::of;
    let (joints, links) = (robot.joints.len(), robot.links.len());
    let labels = (
        of(label()),
        of(label()),
        0..targets,
        any::<bool>(),
        any::<u32>(),
    );
    let times = (
        of(prop_oneof![0.0..1e6f64, number()]),
        of(number()),
        vec(of(number()), links),
    );
    let motion = (
        vec(number(), joints),
        of(vec(prop_oneof![Just(-1.0), Just(0.0), Just(1.0)], joints)),
    );
    let pose = (vector(), of(rotation()));
    let loads = (of((vector(), vector())), of((0.0..1e3f64, vector())));
    (labels, times, motion, pose, loads).prop_map(
        |(labels, (time, temperature, links), motion, pose, (wrench, payload))| Reading {
            line: labels.4 as usize,
            pose: labels.0,
            repeat: labels.1,
            target: labels.2,
            split: if labels.3 { Split::Heldout } else { Split::Fit },
            time,
            temperature,
            link_temperatures: links
                .into_iter()
                .enumerate()
                .filter_map(|(link, t)| Some((link, t?)))
                .collect(),
            joints: motion.0,
            approach: motion.1,
            position: pose.0,
            orientation: pose.1,
            wrench: wrench.map(|(force, torque)| Wrench { force, torque }),
            payload: payload.map(|(mass, com)| Payload { mass, com }),
            process: None,
        },
    )
}

/// Campaigns with every optional part given or not, on a URDF or a DH robot.
pub fn campaign() -> impl Strategy<Value = Campaign> {
    (any::<bool>(), label(), label()).prop_flat_map(|(dh, first, second)| {
        let (name, text) = match dh {
            true => ("table.toml", DH_TABLE),
            false => ("arm.urdf", TWO_ARMS),
        };
        let robot = Robot::parse(name, text, None).unwrap();
        let base = robot.links[0].name.clone();
        let mut targets = vec![Target {
            name: first.clone(),
            link: robot.links.len() - 1,
        }];
        if first != second {
            targets.push(Target {
                name: second,
                link: 1,
            });
        }
        let readings = proptest::collection::vec(reading(&robot, targets.len()), 1..12);
        let frames = proptest::collection::vec(frame(), targets.len());
        let warnings = proptest::collection::vec(".{0,20}", 0..3);
        (
            (readings, frames, frame(), warnings),
            (
                proptest::option::of(noise()),
                vector(),
                any::<bool>(),
                "[a-z. ]{0,9}",
            ),
        )
            .prop_map(
                move |((readings, frames, tracker, warnings), (noise, gravity, named, title))| {
                    Campaign {
                        notes: Vec::new(),
                        name: title,
                        robot: robot.clone(),
                        robot_file: RobotFile {
                            name: name.into(),
                            text: text.into(),
                            base: named.then(|| base.clone()),
                        },
                        gravity,
                        targets: targets.clone(),
                        base_from_tracker: tracker,
                        link_from_target: frames,
                        noise,
                        readings,
                        warnings,
                    }
                },
            )
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn a_written_table_reads_back_the_same(campaign in campaign()) {
        let folder = TempDir::new().unwrap();
        campaign.write_csv(folder.path()).unwrap();
        let mut again = Campaign::load(&folder.path().join("campaign.toml")).unwrap();
        again.warnings.clear();
        assert_same(&as_table(campaign), &again);

        let second = TempDir::new().unwrap();
        again.write_csv(second.path()).unwrap();
        for name in ["campaign.toml", "readings.csv", again.robot_file.name.as_str()] {
            let bytes = |folder: &TempDir| fs::read(folder.path().join(name)).unwrap();
            prop_assert_eq!(bytes(&folder), bytes(&second));
        }
    }

    #[test]
    fn garbage_is_refused_without_panic(table in any::<Vec<u8>>(), document in ".{0,60}") {
        load(ONE_TARGET, table).unwrap_err();
        load(&document, format!("{HEADER}\n")).unwrap_err();
        let _ = load(&format!("{ONE_TARGET}{document}"), format!("{HEADER}\n0,0,0,1,2,3\n"));
    }

    #[test]
    fn damaged_tables_are_read_or_refused_without_panic(
        cells in proptest::collection::vec("[-+0-9.e,\"\n\r;a ]{0,12}", 0..20),
        document in "(gravity|frames|noise|split|target)? ?[]=.\"{}\\[0-9a-z ,\n]{0,30}",
    ) {
        let table = format!("{HEADER},pose,qw,qx,qy,qz\n{}", cells.join(","));
        let _ = load(ONE_TARGET, table);
        let _ = load(&format!("{document}\n{ONE_TARGET}"), "");
    }
}

#[test]
fn a_failed_write_leaves_the_old_files_whole() {
    let folder = TempDir::new().unwrap();
    let mut campaign = load(ONE_TARGET, format!("{HEADER}\n0,0,0,1,2,3\n")).unwrap();
    campaign.write_csv(folder.path()).unwrap();
    let names = || {
        let mut names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        names
    };
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    let old = (names(), bytes("campaign.toml"), bytes("readings.csv"));

    // A number that no table can hold.
    campaign.readings[0].position.x = f64::NAN;
    let message = campaign.write_csv(folder.path()).unwrap_err().to_string();
    assert!(
        message.contains("reading 0") && message.contains("not finite"),
        "{message}"
    );
    assert_eq!(
        old,
        (names(), bytes("campaign.toml"), bytes("readings.csv"))
    );

    // A folder in the way of the first file.
    campaign.readings[0].position.x = 7.0;
    fs::create_dir_all(folder.path().join("other.urdf")).unwrap();
    campaign.robot_file.name = "other.urdf".into();
    let message = campaign.write_csv(folder.path()).unwrap_err().to_string();
    assert!(
        message.contains("other.urdf: cannot be written"),
        "{message}"
    );
    fs::remove_dir(folder.path().join("other.urdf")).unwrap();
    assert_eq!(
        old,
        (names(), bytes("campaign.toml"), bytes("readings.csv"))
    );
}

#[test]
fn campaigns_that_could_not_be_read_back_are_not_written() {
    let good = load(TWO_TARGETS, format!("{HEADER},target\n0,0,0,1,2,3,left\n")).unwrap();
    type Spoil = fn(&mut Campaign);
    let spoil: [(&str, Spoil); 12] = [
        ("plain file name", |c| {
            c.robot_file.name = "../arm.urdf".into()
        }),
        ("own files", |c| c.robot_file.name = "readings.csv".into()),
        ("no reading", |c| c.readings.clear()),
        ("two targets", |c| c.targets[1].name = "left".into()),
        ("on no link", |c| c.targets[1].link = 99),
        ("one frame for each", |c| c.link_from_target.clear()),
        ("joint angles", |c| c.readings[0].joints.clear()),
        ("approach", |c| c.readings[0].approach = Some(vec![2.0; 3])),
        ("target does not exist", |c| c.readings[0].target = 5),
        ("outer blanks", |c| c.readings[0].pose = Some(" a".into())),
        ("order of the robot's links", |c| {
            c.readings[0].link_temperatures = vec![(1, 2.0), (0, 1.0)]
        }),
        ("noise force_N", |c| {
            c.noise = Some(Noise {
                force: -1.0,
                ..Noise::default()
            })
        }),
    ];
    for (part, spoil) in spoil {
        let mut campaign = good.clone();
        spoil(&mut campaign);
        let folder = TempDir::new().unwrap();
        let message = campaign.write_csv(folder.path()).unwrap_err().to_string();
        assert!(message.contains(part), "no {part:?} in {message}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn a_sliding_joint_called_like_a_column_is_refused() {
    let robot = TWO_ARMS.replace("\"slide\"", "\"x\"");
    let folder = TempDir::new().unwrap();
    load_in(
        folder.path(),
        ONE_TARGET,
        "torso_rad,wrist_rad,x_m,y_m,z_m\n0,0,1,2,3\n",
    )
    .unwrap();
    fs::write(folder.path().join("arm.urdf"), robot).unwrap();
    let message = Campaign::load(&folder.path().join("c.toml"))
        .unwrap_err()
        .to_string();
    for part in ["line 1", "`x_m`", "two quantities", "rename"] {
        assert!(message.contains(part), "no {part:?} in {message}");
    }
}
