//! `misfit import`.

use super::{Outcome, print, print_json, progress, spare};
use crate::bag::{self, Spec};
use crate::campaign::Campaign;
use crate::input::{self, LARGEST_TOML};
use crate::recording::{self, Bag};
use crate::report::import as report;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Make a campaign of a ROS 2 bag: clocks brought together, stops found and averaged.
///
/// The bag holds joint states and what a tracker saw of a target on the arm. The offset of the tracker's clock is found from
/// the motion; where it cannot be, that is said and the exit code is 3.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit import calib.mcap                                    its topics, and a spec to start from
  misfit import calib.mcap --spec import.toml                 what would come of it; writes nothing
  misfit import calib.mcap --spec import.toml -o cell/        cell/campaign.toml with its table
  misfit import calib/ --spec import.toml -o cell.mcap        a folder of files; a recording")]
pub struct Arguments {
    /// Bag: an .mcap file, or a folder with .mcap files.
    bag: PathBuf,
    /// Which topics are what (TOML); without it the topics are listed.
    #[arg(long, value_name = "import.toml")]
    spec: Option<PathBuf>,
    /// Folder to write the campaign to as TOML and CSV, or a recording ending in .mcap.
    #[arg(short, long, value_name = "DIR|X.mcap", requires = "spec")]
    output: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let spinner = progress::spinner();
    let Some(path) = &arguments.spec else {
        let bag = recording::read_bag(&arguments.bag, |topic| {
            ["sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"].contains(&topic.kind.as_str())
        })?;
        spinner.finish_and_clear();
        return topics(arguments, &bag);
    };
    let spec = Spec::load(path)?;
    spinner.set_message("reading the bag");
    let bag = recording::read_bag(&arguments.bag, |topic| spec.wants(&topic.topic))?;
    refuse_campaign(&arguments.bag, &bag)?;
    spinner.set_message("clocks and stops");
    let import = bag::import(&bag, &spec)?;
    spinner.finish_and_clear();
    let written = match (&arguments.output, &import.campaign) {
        (Some(output), Some(campaign)) => Some(write(output, campaign, path, &spec, &bag)?),
        _ => None,
    };
    let shown = written.as_ref().map(|path| path.display().to_string());
    if arguments.json {
        print_json(&report::document(&bag, &import, shown.clone()))?;
    } else {
        let next = match (&shown, &import.campaign) {
            (Some(path), _) => format!(
                "\nwrote    {path}\n\nnext     misfit fit {path}     or     misfit diagnose {path}\n"
            ),
            (None, Some(_)) => format!(
                "\nnext     misfit import {} --spec {} -o DIR\n",
                arguments.bag.display(),
                path.display()
            ),
            (None, None) => String::new(),
        };
        print(&(report::text(&bag, &spec, &import) + &next))?;
    }
    if import.campaign.is_none() {
        anyhow::bail!(
            "{}: no reading: {} stops of the joints, none read; nothing was written",
            bag.name,
            import.dwells.stops
        );
    }
    Ok(if import.clocks_are_known() {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}

/// Lists what there is.
fn topics(arguments: &Arguments, bag: &Bag) -> anyhow::Result<Outcome> {
    refuse_campaign(&arguments.bag, bag)?;
    if arguments.json {
        print_json(&report::topics_document(bag))?;
    } else {
        print(&format!(
            "{}\nnext     save it as import.toml, then  misfit import {} --spec import.toml\n",
            report::topics_text(bag),
            arguments.bag.display()
        ))?;
    }
    Ok(Outcome::Done)
}

/// What this program wrote needs no import.
fn refuse_campaign(path: &Path, bag: &Bag) -> anyhow::Result<()> {
    if bag.campaign {
        anyhow::bail!(
            "{0}: is a campaign already; accepted: a bag of another program (try misfit fit {0})",
            path.display()
        );
    }
    Ok(())
}

/// Writes the campaign, and says where it is.
fn write(
    output: &Path,
    campaign: &Campaign,
    spec_path: &Path,
    spec: &Spec,
    bag: &Bag,
) -> anyhow::Result<PathBuf> {
    let recording = output.extension().is_some_and(|ending| ending == "mcap");
    let file = match recording {
        true => output.to_owned(),
        false => output.join("campaign.toml"),
    };
    let mut read: Vec<Option<&Path>> = bag.files.iter().map(|f| Some(f.as_path())).collect();
    read.push(Some(&spec.robot_path));
    spare(&file, spec_path, &read)?;
    if recording {
        let mut campaign = campaign.clone();
        campaign.name = name(output);
        let metadata = BTreeMap::from([
            ("bag".to_owned(), name(Path::new(&bag.name))),
            ("misfit".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ]);
        let attachments = match input::bytes(spec_path, LARGEST_TOML) {
            Ok(bytes) => vec![("import.toml".to_owned(), bytes)],
            Err(_) => Vec::new(),
        };
        let beside = recording::Beside {
            metadata,
            attachments,
            ..recording::Beside::default()
        };
        recording::write_campaign(&campaign, output, &beside)?;
    } else {
        spare(&output.join("readings.csv"), spec_path, &read)?;
        campaign.write_csv(output)?;
    }
    Ok(file)
}

/// File name without ending.
fn name(path: &Path) -> String {
    path.file_stem()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}
