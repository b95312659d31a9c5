//! Tables as people have them: header words, delimiters, encodings, conventions and workbooks of their own.

use crate::two_arms::TWO_ARMS;
use misfit_campaign::{Campaign, LoadError};
use nalgebra::Vector3;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const HEAD: &str = "robot = \"arm.urdf\"\n[[target]]\nname = \"left\"\nlink = \"left_flange\"\n";
const COLUMNS: &str = "[columns]\ntorso = { column = \"J1\", unit = \"deg\" }\n\
    slide = { column = \"J2\", unit = \"mm\" }\nwrist = { column = \"J3\", unit = \"deg\" }\n\
    position = { columns = [\"X\", \"Y\", \"Z\"], unit = \"mm\" }\npose = \"Point\"\n";
const WORDS: &str = "Point,J1,J2,J3,X,Y,Z,Comment";
const ROW: &str = "P1,90,250,-45,1000,2000,-3000.5,ok";

fn load(document: &str, name: &str, table: impl AsRef<[u8]>) -> Result<Campaign, LoadError> {
    let folder = TempDir::new().unwrap();
    load_in(folder.path(), document, name, table)
}

fn load_in(
    folder: &Path,
    document: &str,
    name: &str,
    table: impl AsRef<[u8]>,
) -> Result<Campaign, LoadError> {
    fs::write(folder.join("arm.urdf"), TWO_ARMS).unwrap();
    fs::write(folder.join("c.toml"), document).unwrap();
    fs::write(folder.join(name), table).unwrap();
    Campaign::load(&folder.join("c.toml"))
}

/// A campaign file with these keys of `[table]` beside the file.
fn document(table: &str, columns: &str) -> String {
    format!("{HEAD}[table]\nfile = \"t.csv\"\n{table}\n{columns}")
}

#[track_caller]
fn refused(document: &str, table: impl AsRef<[u8]>, parts: &[&str]) {
    let message = load(document, "t.csv", table)
        .expect_err("should be refused")
        .to_string();
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

/// The one reading of [`ROW`], whatever the table is written in.
#[track_caller]
fn is_the_row(campaign: &Campaign) {
    let joint = |name| campaign.robot.joint(name).unwrap();
    let reading = &campaign.readings[0];
    assert_eq!(reading.joints[joint("torso")], 90f64.to_radians());
    assert_eq!(reading.joints[joint("slide")], 0.25);
    assert_eq!(reading.joints[joint("wrist")], (-45f64).to_radians());
    assert_eq!(reading.position, Vector3::new(1.0, 2.0, -3.0005));
    assert_eq!(reading.pose.as_deref(), Some("P1"));
}

#[test]
fn own_header_words_are_read_and_others_ignored_by_name() {
    let campaign = load(&document("", COLUMNS), "t.csv", format!("{WORDS}\n{ROW}\n")).unwrap();
    is_the_row(&campaign);
    assert_eq!(campaign.readings.len(), 1);
    assert_eq!(
        campaign.notes,
        ["t.csv: column ignored, not named under [columns]: \"Comment\""]
    );
    assert!(campaign.warnings.is_empty(), "{:?}", campaign.warnings);
}

#[test]
fn words_of_the_plain_format_keep_their_meaning_beside_own_ones() {
    let columns = "[columns]\nwrist = { column = \"R\", unit = \"deg\", sign = -1, offset = 5 }\n";
    let table = "torso_rad,slide_m,wrist_deg,R,x_m,y_m,z_m\n0.5,0.25,77,10,1,2,3\n";
    let campaign = load(&document("", columns), "t.csv", table).unwrap();
    let joints = &campaign.readings[0].joints;
    let joint = |name| joints[campaign.robot.joint(name).unwrap()];
    assert_eq!((joint("torso"), joint("slide")), (0.5, 0.25));
    assert_eq!(joint("wrist"), (-5f64).to_radians());
    assert!(
        campaign.notes[0].ends_with("\"wrist_deg\""),
        "{:?}",
        campaign.notes
    );
}

#[test]
fn delimiters_decimals_and_what_stands_around_a_table() {
    let semicolons = |text: &str| text.replace(',', ";").replace("3000.5", "3000,5");
    let tabs = |text: &str| text.replace(',', "\t");
    let padded = |text: &str| text.replace(',', "  \t ");
    let bars = |text: &str| text.replace(',', "|");
    let preamble = "Cell 7, \"north\n\n";
    let units = ",deg,[mm],(°),mm,millimeter,MM,";
    let without = COLUMNS
        .replace(", unit = \"deg\"", "")
        .replace(", unit = \"mm\"", "");
    let cases = [
        (
            "decimal = \",\"",
            COLUMNS,
            format!("{}\r\n{}\r\n", semicolons(WORDS), semicolons(ROW)),
        ),
        (
            "decimal = \",\"\ndelimiter = \";\"",
            COLUMNS,
            format!("{}\n{}\n;;;;;;;\n", semicolons(WORDS), semicolons(ROW)),
        ),
        (
            "delimiter = \"tab\"",
            COLUMNS,
            format!("{}\n{}\n", tabs(WORDS), tabs(ROW)),
        ),
        (
            "delimiter = \"\\t\"",
            COLUMNS,
            format!("{}\n{}\n", tabs(WORDS), tabs(ROW)),
        ),
        (
            "delimiter = \"blanks\"",
            COLUMNS,
            format!("{}\n{}\n", padded(WORDS), padded(ROW)),
        ),
        (
            "delimiter = \"|\"",
            COLUMNS,
            format!("{}\n{}\n", bars(WORDS), bars(ROW)),
        ),
        (
            "header_row = 3",
            COLUMNS,
            format!("{preamble}{WORDS}\n{ROW}\n"),
        ),
        (
            "header_row = 3\nunits_row = 4",
            without.as_str(),
            format!("{preamble}{WORDS}\n{units}\n{ROW}\n"),
        ),
        (
            "comment = \"#\"",
            COLUMNS,
            format!("# \"made by\n{WORDS}\n# another\n{ROW}\n#\n").replacen("# \"made by\n", "", 1),
        ),
    ];
    for (table, columns, text) in &cases {
        let campaign = load(&document(table, columns), "t.csv", text);
        is_the_row(&campaign.unwrap_or_else(|error| panic!("{table}: {error}")));
    }
    let campaign = load(&document(cases[8].0, COLUMNS), "t.csv", &cases[8].2).unwrap();
    assert_eq!(
        campaign.readings[0].line, 3,
        "lines as an editor counts them"
    );
    let campaign = load(&document(cases[7].0, &without), "t.csv", &cases[7].2).unwrap();
    assert_eq!(campaign.readings[0].line, 5);
}

#[test]
fn encodings_with_and_without_a_mark() {
    let text = format!("{}\n{ROW}\n", WORDS.replace("Comment", "Bemerkung Prüfung"));
    let utf16 = |mark: bool, bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
        let units = std::iter::once(0xfeff)
            .filter(|_| mark)
            .chain(text.encode_utf16());
        units.flat_map(bytes).collect()
    };
    let latin: Vec<u8> = text
        .chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap())
        .collect();
    for (table, bytes) in [
        ("", [b"\xef\xbb\xbf".as_slice(), text.as_bytes()].concat()),
        ("", utf16(true, u16::to_le_bytes)),
        ("", utf16(true, u16::to_be_bytes)),
        ("encoding = \"utf-16le\"", utf16(false, u16::to_le_bytes)),
        ("encoding = \"windows-1252\"", latin.clone()),
    ] {
        let campaign = load(&document(table, COLUMNS), "t.csv", bytes).unwrap();
        is_the_row(&campaign);
        assert!(
            campaign.notes[0].contains("Prüfung"),
            "{:?}",
            campaign.notes
        );
    }
    refused(&document("", COLUMNS), latin, &["t.csv, line 1", "UTF-8"]);
    // the plain format too
    let plain = "torso_rad,slide_m,wrist_deg,x_m,y_m,z_m\n0,0,0,1,2,3\n";
    let units = std::iter::once(0xfeff).chain(plain.encode_utf16());
    let bytes: Vec<u8> = units.flat_map(u16::to_le_bytes).collect();
    let campaign = load(&document("", ""), "t.csv", bytes).unwrap();
    assert_eq!(campaign.readings[0].position, Vector3::new(1.0, 2.0, 3.0));
}

#[test]
fn several_targets_in_one_row() {
    let head = format!("{HEAD}[[target]]\nname = \"right\"\nlink = \"right_flange\"\n");
    let columns = "[columns]\ntorso = { column = \"J1\", unit = \"deg\" }\n\
        [columns.position]\nleft = { columns = [\"Xl\", \"Yl\", \"Zl\"], unit = \"mm\" }\n\
        right = { columns = [5, 6, 7], unit = \"m\" }\n\
        [columns.orientation]\nright = { columns = [\"A\", \"B\", \"C\"], convention = \"kuka_abc\", unit = \"deg\" }\n";
    let document = format!("{head}[table]\nfile = \"t.csv\"\n{columns}");
    let table =
        "J1,Xl,Yl,Zl,Xr,Yr,Zr,A,B,C\n1,10,20,30,4,5,6,90,0,0\n2,,,,7,8,9,0,0,0\n3,,,,,,,,,\n";
    let campaign = load(&document, "t.csv", table).unwrap();
    let seen: Vec<(usize, usize, f64, bool)> = campaign
        .readings
        .iter()
        .map(|r| (r.line, r.target, r.position.x, r.orientation.is_some()))
        .collect();
    assert_eq!(
        seen,
        [(2, 0, 0.01, false), (2, 1, 4.0, true), (3, 1, 7.0, true)]
    );
    let turned = campaign.readings[1].orientation.unwrap() * Vector3::x();
    assert!((turned - Vector3::y()).norm() < 1e-12);
    assert!(
        campaign
            .notes
            .iter()
            .any(|n| n.contains("1 rows without the position"))
    );
    for (from, to, parts) in [
        (
            "left = {",
            "centre = {",
            ["columns.position.centre", "left, right"],
        ),
        (
            "torso =",
            "target = \"J1\"\ntorso =",
            ["columns.target", "one of the two"],
        ),
        (
            "right = { columns = [5, 6, 7], unit = \"m\" }\n",
            "",
            ["columns.orientation.right", "without a position"],
        ),
    ] {
        let message = load(&document.replace(from, to), "t.csv", table)
            .unwrap_err()
            .to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn what_columns_and_table_may_not_say() {
    let table = format!("{WORDS}\n{ROW}\n");
    for (from, to, parts) in [
        (
            "\"J1\"",
            "\"J9\"",
            vec!["line 1, column `J9`", "columns.torso", "\"J1\""],
        ),
        ("\"J1\"", "9", vec!["number 9", "numbers from 1 to 8"]),
        ("\"J1\"", "0", vec!["number 0"]),
        (
            "\"J1\"",
            "\"J2\"",
            vec!["two quantities", "columns.slide", "columns.torso"],
        ),
        (
            "unit = \"deg\"",
            "unit = \"mm\"",
            vec!["columns.torso.unit", "rad, mrad"],
        ),
        (", unit = \"deg\"", "", vec!["column `J1`", "no unit"]),
        (
            "torso =",
            "torsoo =",
            vec!["columns.torsoo", "torso, slide, wrist"],
        ),
        (
            "[\"X\", \"Y\", \"Z\"]",
            "[\"X\", \"Y\"]",
            vec!["columns.position", "2 columns", "3 header words"],
        ),
        (
            "column = \"J1\", unit",
            "colum = \"J1\", unit",
            vec!["columns.torso", "colum"],
        ),
        (
            "unit = \"mm\" }\npose",
            "unit = \"mm\", sign = -1 }\npose",
            vec!["columns.position", "joint alone"],
        ),
        (
            "pose = \"Point\"",
            "pose = { column = \"Point\", unit = \"m\" }",
            vec!["columns.pose.unit"],
        ),
        (
            "pose =",
            "orientation = { columns = [\"X\", \"Y\", \"Z\"], convention = \"abc\", unit = \"deg\" }\npose =",
            vec!["columns.orientation.convention", "kuka_abc"],
        ),
        (
            "position = { columns = [\"X\", \"Y\", \"Z\"], unit = \"mm\" }\n",
            "",
            vec!["column `x_m`", "[columns]"],
        ),
    ] {
        assert!(COLUMNS.contains(from), "{from}");
        refused(
            &document("", &COLUMNS.replacen(from, to, 1)),
            &table,
            &parts,
        );
    }
    for (keys, parts) in [
        ("delimiter = \"ab\"", ["table.delimiter", "tab"]),
        ("decimal = \";\"", ["table.decimal", "\",\""]),
        (
            "decimal = \",\"\ndelimiter = \",\"",
            ["table.delimiter", "two different"],
        ),
        ("header_row = 0", ["table.header_row", "from 1"]),
        ("header_row = 9", ["line 3", "header words in line 9"]),
        ("units_row = 1", ["table.units_row", "below the header"]),
        ("encoding = \"klingon\"", ["table.encoding", "windows-1252"]),
        ("comment = \"//\"", ["table.comment", "one ASCII character"]),
        ("colour = 1", ["key `table`", "colour"]),
    ] {
        refused(&document(keys, COLUMNS), &table, &parts);
    }
    for (cell, parts) in [
        ("1,000", ["line 2", "10 cells"]),
        ("\"2,000\"", ["column `Y`", "nothing between thousands"]),
        ("2'000", ["column `Y`", "nothing between thousands"]),
        ("-", ["column `Y`", "a point for decimals"]),
    ] {
        let table = table.replace(
            "2000",
            &if cell == "1,000" {
                "1,000,0".into()
            } else {
                cell.to_owned()
            },
        );
        refused(&document("", COLUMNS), table, &parts);
    }
    let german = table.replace(',', ";").replace("3000.5", "3.000,5");
    refused(
        &document("decimal = \",\"", COLUMNS),
        german,
        &["column `Z`", "3.000,5", "thousands"],
    );
}

#[test]
fn a_sheet_of_a_workbook() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("t.xlsx");
    let mut book = rust_xlsxwriter::Workbook::new();
    book.add_worksheet().set_name("notes").unwrap();
    let sheet = book.add_worksheet().set_name("poses").unwrap();
    for (column, (word, cell)) in WORDS.split(',').zip(ROW.split(',')).enumerate() {
        let column = column as u16;
        sheet.write(2, column, word).unwrap();
        match cell.parse::<f64>() {
            Ok(number) => sheet.write(4, column, number).unwrap(),
            Err(_) => sheet.write(4, column, cell).unwrap(),
        };
    }
    book.save(&path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let document =
        |keys: &str| format!("{HEAD}[table]\nfile = \"t.xlsx\"\nheader_row = 3\n{keys}\n{COLUMNS}");
    for keys in ["sheet = \"poses\"", "sheet = \"poses\"\ndecimal = \",\""] {
        let campaign = load(&document(keys), "t.xlsx", &bytes).unwrap();
        is_the_row(&campaign);
        assert_eq!(campaign.readings[0].line, 5);
    }
    for keys in ["", "sheet = \"Poses\""] {
        let message = load(&document(keys), "t.xlsx", &bytes)
            .unwrap_err()
            .to_string();
        assert!(message.contains("\"notes\", \"poses\""), "{message}");
    }
    // whatever is cut off or damaged: an error, no panic
    for cut in (0..bytes.len()).step_by(97) {
        assert!(load(&document("sheet = \"poses\""), "t.xlsx", &bytes[..cut]).is_err());
    }
    let mut damaged = bytes.clone();
    for at in (0..bytes.len()).step_by(61) {
        damaged[at] ^= 0x55;
        let _ = load(&document("sheet = \"poses\""), "t.xlsx", &damaged);
        damaged[at] = bytes[at];
    }
}
