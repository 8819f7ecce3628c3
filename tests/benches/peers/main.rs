//! The daemon and the in-process engines against other broad phases; see `--help`.

mod lanes;
mod measure;
mod options;

use std::error::Error;
use std::io::{Write as _, stdout};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use options::{Format, Options};
use pairmask_tests::peers::line::Comparison;
use pairmask_tests::peers::{report, svg};
use pairmaskd::scene::Scene;
use pairmaskd::spawn::{PrivateDaemon, PrivateSettings};

/// The daemon's own main, which cargo builds beside this bench.
const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(comparisons) if comparisons.iter().any(Comparison::is_wrong) => ExitCode::FAILURE,
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("peers: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(options: &Options) -> Result<Vec<Comparison>, Box<dyn Error>> {
    let settings = PrivateSettings {
        spin: Duration::from_micros(options.daemon_spin_us),
        gpu: options.gpu.clone().into(),
        ..PrivateSettings::default()
    };
    let daemon = PrivateDaemon::start(DAEMON.as_ref(), &settings)?;
    let format = options.format();
    if format == Format::Text {
        println!("{}\n\n{}", report::HEAD, report::text_head().trim_end());
    }
    let mut comparisons = Vec::new();
    for name in options.scenes() {
        for &n in &options.n {
            let scene = Scene::new(name, n, options.seed);
            let lanes = lanes::lanes(scene.boxes(), &daemon, options)?;
            let comparison = measure::measure(name, scene, lanes, options)?;
            match format {
                Format::Text => print!("{}", report::text(&comparison)),
                Format::Json => print!("{}", report::json_lines(&comparison)),
                Format::Csv | Format::Markdown | Format::Svg => {
                    eprintln!("{name}, {n} boxes: measured");
                }
            }
            stdout().flush()?;
            comparisons.push(comparison);
        }
    }
    match format {
        Format::Csv => print!("{}", report::csv(&comparisons)),
        Format::Markdown => print!("{}", report::markdown(&comparisons)),
        Format::Svg => print!("{}", svg::plot(&comparisons)),
        Format::Text | Format::Json => (),
    }
    if let Some(dir) = &options.out {
        write_all(dir, &comparisons)?;
    }
    Ok(comparisons)
}

fn write_all(dir: &Path, comparisons: &[Comparison]) -> std::io::Result<()> {
    std::fs::create_dir_all(dir)?;
    let json: String = comparisons.iter().map(report::json_lines).collect();
    std::fs::write(dir.join("peers.jsonl"), json)?;
    std::fs::write(dir.join("peers.csv"), report::csv(comparisons))?;
    std::fs::write(dir.join("peers.md"), report::markdown(comparisons))?;
    std::fs::write(dir.join("peers.svg"), svg::plot(comparisons))
}
