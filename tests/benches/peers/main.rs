//! The daemon and the in-process engines against other broad phases; see `--help`.

mod cliffs;
mod entrants;
mod measure;
mod options;
mod ours;
mod parry;
mod recipe;

use std::error::Error;
use std::io::{Write as _, stdout};
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use options::Options;
use pairmask_tests::daemon::pairmaskd;
use pairmask_tests::peers::line::Comparison;
use pairmask_tests::peers::report;
use pairmaskd::scene::Scene;
use pairmaskd::serve::DaemonSettings;
use pairmaskd::spawn::PrivateDaemon;

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
    if let Some(seconds) = options.search {
        let (n, threads) = (options.n.first(), options.threads.last());
        let (Some(n), Some(threads)) = (n, threads) else { return Ok(Vec::new()) };
        cliffs::search(*n, *threads, options.seed, seconds)?;
        return Ok(Vec::new());
    }
    let settings = DaemonSettings {
        spin: Duration::from_micros(options.daemon_spin_us),
        gpu: options.gpu.clone().into(),
        ..DaemonSettings::default()
    };
    let daemon = PrivateDaemon::start(&pairmaskd(), &settings)?;
    let is_text = !options.json && !options.markdown;
    if is_text {
        println!("{}\n\n{}", report::HEAD, report::text_head().trim_end());
    }
    let mut comparisons = Vec::new();
    for &name in &options.scene.0 {
        for &n in &options.n {
            let scene = Scene::new(name, n, options.seed);
            let entrants = entrants::entrants(scene.boxes(), &daemon, options)?;
            let comparison = measure::measure(name, scene, entrants, options)?;
            if is_text {
                print!("{}", report::text(&comparison));
            } else if options.json {
                print!("{}", report::json_lines(&comparison));
            }
            stdout().flush()?;
            comparisons.push(comparison);
        }
    }
    if options.markdown {
        print!("{}", report::markdown(&comparisons));
    }
    if let Some(dir) = &options.out {
        std::fs::create_dir_all(dir)?;
        let json: String = comparisons.iter().map(report::json_lines).collect();
        std::fs::write(dir.join("peers.jsonl"), json)?;
        std::fs::write(dir.join("peers.md"), report::markdown(&comparisons))?;
    }
    Ok(comparisons)
}
